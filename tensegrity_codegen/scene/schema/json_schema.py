"""The JSON schema of scene files, for editors that complete and check TOML."""

from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core.core_schema import NullableSchema

from tensegrity_codegen.scene.schema.schema import Scene


class _WithoutNull(GenerateJsonSchema):
    """TOML has no null: an optional key is simply left out."""

    def nullable_schema(self, schema: NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])


def scene_json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scene file, for editors that complete and check TOML."""
    schema = Scene.model_json_schema(schema_generator=_WithoutNull)
    return {"$schema": _WithoutNull.schema_dialect, **_without_null_defaults(schema)}


def _without_null_defaults(node: Any) -> Any:
    if isinstance(node, dict):
        return {
            key: _without_null_defaults(value)
            for key, value in node.items()
            if not (key == "default" and value is None)
        }
    return [_without_null_defaults(item) for item in node] if isinstance(node, list) else node
