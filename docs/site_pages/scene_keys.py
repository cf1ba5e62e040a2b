"""Keys of scene files, made from the JSON schema."""

import json
from typing import Any

from site_pages.markdown import escape, write_item
from tensegrity_codegen.scene.schema.schema import scene_json_schema

Node = dict[str, Any]


def write_scene_keys() -> str:
    """Return Markdown: the sections of a scene, then each kind of table with its keys."""
    schema = scene_json_schema()
    parts = ["## Sections of a scene", _write_keys(schema)]
    for name, table in schema["$defs"].items():
        if "properties" in table:
            parts += [f"## {name}", escape(table.get("description", "")), _write_keys(table)]
    return "\n\n".join(part for part in parts if part)


def _write_keys(table: Node) -> str:
    required = table.get("required", [])
    return "\n".join(_write_key(key, value, key in required) for key, value in table["properties"].items())


def _write_key(key: str, value: Node, required: bool) -> str:
    facts = [_describe(value)]
    if required:
        facts.append("required")
    elif "default" in value and value["default"] not in (None, {}, []):
        facts.append(f"default `{json.dumps(value['default'])}`")
    sentence = escape(" ".join(value.get("description", "").split()))
    return write_item(f"`{key}` ({', '.join(facts)})", sentence)


def _describe(value: Node) -> str:
    """Return the type of a value in words."""
    if "$ref" in value:
        name = value["$ref"].rsplit("/", 1)[1]
        return f"[{name}](#{name.lower()})"
    if "enum" in value:
        return "one of " + ", ".join(f"`{json.dumps(item)}`" for item in value["enum"])
    if "const" in value:
        return f"`{json.dumps(value['const'])}`"
    for key in ("oneOf", "anyOf", "allOf"):
        if key in value:
            words = dict.fromkeys(_describe(item) for item in value[key])
            return " or ".join(words)
    return _describe_type(value)


def _describe_type(value: Node) -> str:
    kind = value.get("type", "any value")
    if kind == "array":
        least, most = value.get("minItems"), value.get("maxItems")
        count = f"{least} of: " if least is not None and least == most else "list of: "
        return count + _describe(value.get("items", {}))
    if kind == "object" and isinstance(value.get("additionalProperties"), dict):
        return f"table of: {_describe(value['additionalProperties'])}"
    return str({"object": "table", "string": "text", "boolean": "true or false"}.get(kind, kind))
