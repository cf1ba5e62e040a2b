"""JSON files that are read without trust: of limited size, each key once, no NaN."""

import json
from pathlib import Path
from typing import Any

from tensegrity_codegen.scene.formats.imported import read_text
from tensegrity_codegen.system.errors import DuplicateNameError, NonFiniteError, SceneSyntaxError

LARGEST_JSON = 32 * 2**20  # bytes
MOST_VALUES = 4_000_000  # of one file


def read_json(path: Path, what: str) -> Any:
    """Return the content of a JSON file, which holds `what`; each key once, no NaN, of limited size."""
    return parse_json(read_text(path, LARGEST_JSON, what), path)


def parse_json(text: str, path: Path) -> Any:
    """Return the content of JSON text from a file, as `read_json` does."""
    count = sum(text.count(sign) for sign in ",[{")
    if count > MOST_VALUES:
        raise SceneSyntaxError(
            "the file has too many values", where=str(path), given=count, allowed=f"up to {MOST_VALUES}"
        )

    def refuse(word: str) -> Any:
        raise NonFiniteError("not a finite number", where=str(path), given=word, allowed="finite numbers")

    def read_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        table: dict[str, Any] = {}
        for key, value in pairs:
            if key in table:
                raise DuplicateNameError(
                    "a key is given twice in one object", where=str(path), given=key, allowed="each key once"
                )
            table[key] = value
        return table

    try:
        return json.loads(text, object_pairs_hook=read_object, parse_constant=refuse)
    except json.JSONDecodeError as error:
        place = f"{path}: line {error.lineno}, column {error.colno}"
        raise SceneSyntaxError(f"not valid JSON: {error.msg}", where=place, allowed="JSON") from None
    except RecursionError:
        raise SceneSyntaxError("the file is nested too deeply", where=str(path)) from None
    except ValueError:  # an integer of thousands of digits
        raise SceneSyntaxError("a number has too many digits", where=str(path)) from None
