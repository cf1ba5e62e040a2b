"""Keys of scene files, made from the JSON schema."""

import json
from typing import Any

from site_pages.markdown import escape, write_item
from tensegrity_codegen.scene.schema.schema import scene_json_schema
from tensegrity_codegen.tables.quantities import QUANTITIES

Node = dict[str, Any]


def write_scene_keys() -> str:
    """Return Markdown: the sections of a scene, then each kind of table with its keys."""
    schema = scene_json_schema()
    tables = {name: table for name, table in schema["$defs"].items() if "properties" in table}
    shared = tables["MemberClass"]["properties"]
    parts = ["## Sections of a scene", _write_keys(schema, schema["$defs"])]
    for name, table in tables.items():
        own = table
        words = [escape(table.get("description", ""))]
        if name != "MemberClass" and shared.keys() - table["properties"].keys() <= {"kind"}:
            keys = {key: value for key, value in table["properties"].items() if value != shared.get(key)}
            own = {**table, "properties": keys}
            words.append("All values of [MemberClass](#memberclass), which override those of the class, and:")
        parts += [f"## {name}", *_write_place(name, schema), *words, _write_keys(own, schema["$defs"])]
    return "\n\n".join(part for part in parts if part)


def _write_place(name: str, schema: Node) -> list[str]:
    """Return how a scene writes this table, if it is one of its sections."""
    for key, value in schema["properties"].items():
        frame = ("[{}.NAME]", "[[{}]]") if _find_entries(value) else ("[{}]", "[[{}]]")
        if f'/{name}"' in json.dumps(value):
            return [f"In a scene: `{frame[value.get('type') == 'array'].format(key)}`"]
    return []


def _find_entries(value: Node) -> Any:
    """Return what the entries of a table with free names are; None for other values."""
    patterns = list(value.get("patternProperties", {}).values())
    entries = patterns[0] if patterns else value.get("additionalProperties")
    return entries if isinstance(entries, dict) else None


def _write_keys(table: Node, tables: Node) -> str:
    required = table.get("required", [])
    return "\n".join(
        _write_key(key, value, key in required, tables) for key, value in table["properties"].items()
    )


def _write_key(key: str, value: Node, required: bool, tables: Node) -> str:
    facts = [_describe(value)]
    if required:
        facts.append("required")
    elif "default" in value and value["default"] not in (None, "", {}, []):
        facts.append(f"default `{json.dumps(value['default'])}`")
    target = tables.get(value.get("$ref", "").rpartition("/")[2], {})
    sentence = value.get("description", target.get("description", ""))
    return write_item(f"`{key}` ({', '.join(facts)})", escape(" ".join(sentence.split())))


def _describe(value: Node) -> str:
    """Return the type of a value in words."""
    if "$ref" in value:
        name = value["$ref"].rsplit("/", 1)[1]
        return f"[{name}](#{name.lower()})"
    if "enum" in value and set(value["enum"]) == set(QUANTITIES):
        return "[quantities](../quantities.md)"
    if "enum" in value:
        words = [f"`{json.dumps(item)}`" for item in value["enum"] if item != ""]
        return ("one of " if len(words) > 1 else "") + ", ".join(words)
    if "const" in value:
        return f"`{json.dumps(value['const'])}`"
    for key in ("oneOf", "anyOf", "allOf"):
        if key in value:
            return " or ".join(dict.fromkeys(_describe(item) for item in value[key]))
    return _describe_type(value)


LIMITS = {"exclusiveMinimum": "above", "minimum": "from", "maximum": "to", "exclusiveMaximum": "below"}


def _describe_type(value: Node) -> str:
    kind = value.get("type", "any value")
    if kind == "array":
        least, most = value.get("minItems"), value.get("maxItems")
        count = f"{least} of: " if least is not None and least == most else "list of: "
        return count + _describe(value.get("items", {}))
    entries = _find_entries(value)
    if kind == "object" and entries is not None:
        return f"table of: {_describe(entries)}"
    if kind in ("number", "integer"):
        return " ".join([kind, *(f"{word} {value[key]:g}" for key, word in LIMITS.items() if key in value)])
    return str({"object": "table", "string": "text", "boolean": "true or false"}.get(kind, kind))
