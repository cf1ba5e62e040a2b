"""All texts of a controller: its own files, those of its model, its description."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from tensegrity_codegen.codegen.describe import made_by
from tensegrity_codegen.codegen.emit import GeneratedSource, emit
from tensegrity_codegen.control.embedded.description import ControllerDescription
from tensegrity_codegen.control.embedded.parts import ControllerParts, find_quantities
from tensegrity_codegen.control.embedded.source import build_context, find_names, write_controller
from tensegrity_codegen.control.embedded.status import CONTROL_STATUS
from tensegrity_codegen.tables.precision import Precision
from tensegrity_codegen.tables.request import ModelRequest

ITEM_BYTES = {"int": 4, "unsigned char": 1, "float": 4, "double": 8}
SPANS = re.compile(r"/\*.*?\*/|#ifdef __cplusplus\n.*?#endif|^#[^\n]*", re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class ControllerFiles:
    """Texts of the files of a controller by name, without its manifest; and its description."""

    texts: Mapping[str, str]
    description: ControllerDescription

    def sources(self) -> dict[str, str]:
        """Return the C files of the library."""
        return {
            name: text
            for name, text in self.texts.items()
            if name.endswith((".c", ".h")) and name != "example.c"
        }


def write_files(parts: ControllerParts, request: ModelRequest, precision: Precision) -> ControllerFiles:
    """Return the files of a controller and of its model, which has only what the controller calls."""
    source = _emit_model(parts, request)
    model = None if source is None else source.manifest
    context = build_context(parts, model, precision)
    texts = write_controller(context)
    if source is not None:
        texts |= {name: source.files[name] for name in source.files if name.startswith(parts.model_name)}
    header = texts[f"{parts.name}_control.h"]
    description = ControllerDescription(
        name=parts.name,
        precision=precision.name,
        sample=parts.sample,
        duration=parts.motion.duration,
        sizes=context["sizes"],
        knots=context["knots"],
        actuators=find_names(parts)["actuator"],
        coordinates=find_names(parts)["coordinate"],
        sensors=find_names(parts)["sensor"],
        inputs=parts.motion.input_name,
        statuses=tuple(CONTROL_STATUS),
        table_bytes=_count_bytes(context),
        library="",
        declarations=read_declarations(header),
        made_by=made_by(),
        model=None if model is None else json.loads(model.to_json()),
    )
    return ControllerFiles(texts, description)


def _emit_model(parts: ControllerParts, request: ModelRequest) -> GeneratedSource | None:
    quantities = find_quantities(parts)
    if not quantities:
        return None
    return emit(replace(parts.subject, name=parts.model_name), replace(request, quantities=quantities))


def _count_bytes(context: Mapping[str, Any]) -> int:
    return sum(ITEM_BYTES[table.c_type] * len(table.values) for table in context["tables"])


def read_declarations(header: str) -> str:
    """Return types and functions of the header as C that cffi reads, with the enumerations of sizes."""
    text = re.sub(r"\b\w+_API ", "", SPANS.sub("", header))
    return re.sub(r"\s+", " ", text).replace("; ", ";\n").strip()
