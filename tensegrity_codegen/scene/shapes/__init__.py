"""Structures by a few words: prism, stacked tower, icosahedron, two nodes."""

from collections.abc import Mapping
from typing import Annotated, Any, TypeAlias

from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from tensegrity_codegen.scene.names import unknown_key
from tensegrity_codegen.scene.shapes.icosahedron import IcosahedronShape
from tensegrity_codegen.scene.shapes.parts import turn_onto_facet
from tensegrity_codegen.scene.shapes.prism import PrismShape
from tensegrity_codegen.scene.shapes.tower import TowerShape
from tensegrity_codegen.scene.shapes.two_nodes import TwoNodeShape
from tensegrity_codegen.system.errors import InvalidValueError

Shape: TypeAlias = Annotated[
    PrismShape | TowerShape | IcosahedronShape | TwoNodeShape, Field(discriminator="kind")
]

_ADAPTER: TypeAdapter[Any] = TypeAdapter(Shape)


def expand_shape(shape: BaseModel | Mapping[str, Any], where: str = "shape") -> dict[str, Any]:
    """Return the nodes, members and groups that a shape stands for, as a plain scene document."""
    model = shape if isinstance(shape, BaseModel) else _validate(shape, where)
    if not isinstance(model, PrismShape | TowerShape | IcosahedronShape | TwoNodeShape):
        raise InvalidValueError("not a shape", where=where, given=model, allowed="one of the shape models")
    document = model.expand(where)
    if model.on_facet is not None:
        turn_onto_facet(document["nodes"], model.on_facet, f"{where}.on_facet")
    return document


def _validate(shape: Mapping[str, Any], where: str) -> BaseModel:
    try:
        model: BaseModel = _ADAPTER.validate_python(dict(shape))
    except ValidationError as error:
        detail = min(error.errors(include_url=False), key=lambda item: item["type"] != "extra_forbidden")
        key = str(detail["loc"][-1]) if detail["loc"] else "kind"
        if detail["type"] == "extra_forbidden":
            models = (PrismShape, TowerShape, IcosahedronShape, TwoNodeShape)
            made = [model for model in models if model.kind_name() == str(detail["loc"][0])]
            raise unknown_key(key, [key for model in made for key in model.model_fields], where) from None
        raise InvalidValueError(detail["msg"], where=f"{where}.{key}", given=detail["input"]) from None
    return model
