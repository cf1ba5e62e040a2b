"""The compatibility rule of generated headers (docs/c_api.md): what a change of a header breaks."""

import re
from dataclasses import dataclass

from tensegrity_codegen.tables.manifest import SOLVER_STATUS, STATUS

COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
DIRECTIVE = re.compile(r"^#[^\n]*|extern \"C\" \{", re.MULTILINE)
ENUMERATION = re.compile(r"enum(?: \w+)? \{(.*?)\};", re.DOTALL)
STRUCT = re.compile(r"typedef struct \{(.*?)\} (\w+);", re.DOTALL)
CONSTANT = re.compile(r"extern \w+_API const (\w+) (\w+)(\[[^;]*\])?;")
FUNCTION = re.compile(r"^\w+_API ([^;(]*?)(\w+)\(([^;]*)\);", re.MULTILINE | re.DOTALL)
MACRO = re.compile(r"^#define (\w+) (\S+)$", re.MULTILINE)

# Numbers that a program takes by their names: sizes of work arrays, and the versions themselves.
FREE = re.compile(r"_WORK$|_ABI_VERSION$|_C_API_VERSION$")
# Names that a header only has where its functions use them.
IF_USED = re.compile(rf"_N_(STATES|INPUTS)$|_nominal_\w+$|_({'|'.join((*STATUS, *SOLVER_STATUS)).upper()})$")


@dataclass(frozen=True)
class Interface:
    """What a header declares, each by its name."""

    constants: dict[str, str]
    structs: dict[str, list[str]]
    arrays: dict[str, str]
    functions: dict[str, str]
    macros: dict[str, str]


def read_interface(header: str) -> Interface:
    """Return what a generated header declares, without comments and parameter names."""
    text = COMMENT.sub("", header)
    macros = {name: value for name, value in MACRO.findall(text) if not name.endswith("_API")}
    text = DIRECTIVE.sub("", text)
    constants: dict[str, str] = {}
    for body in ENUMERATION.findall(text):
        constants |= {
            name.strip(): value.strip() for name, value in (row.split("=") for row in body.split(","))
        }
    structs = {
        name: [_squeeze(row) for row in body.split(";") if row.strip()] for body, name in STRUCT.findall(text)
    }
    arrays = {name: f"{kind}{size}" for kind, name, size in CONSTANT.findall(text)}
    functions = {
        name: f"{_squeeze(kind)} ({', '.join(_type_of(item) for item in arguments.split(','))})"
        for kind, name, arguments in FUNCTION.findall(text)
    }
    return Interface(constants, structs, arrays, functions, macros)


def find_breaks(old: str, new: str) -> list[str]:
    """Return what a program written for the header `old` would miss in `new`; empty: compatible.

    Functions keep their types, constants their values (but sizes of work arrays and versions), arrays their
    types and sizes; structs keep their fields and their order, and may gain fields at the end. What no
    function uses any more may go: statuses, sizes of states and inputs, nominal values.
    """
    first, second = read_interface(old), read_interface(new)
    found = []
    for what in ("constants", "arrays", "functions", "macros"):
        before, after = getattr(first, what), getattr(second, what)
        for name, value in before.items():
            if name not in after and not IF_USED.search(name):
                found.append(f"{what}: {name} is gone")
            elif after.get(name, value) != value and not FREE.search(name):
                found.append(f"{what}: {name} was {value}, is {after[name]}")
    for name, fields in first.structs.items():
        if second.structs.get(name, [])[: len(fields)] != fields:
            found.append(f"structs: {name} has lost or changed fields")
    return found


def _squeeze(text: str) -> str:
    return " ".join(text.split())


def _type_of(parameter: str) -> str:
    """Return the type of a parameter, without its name; of work memory without its size."""
    text = _squeeze(parameter)
    kind = re.sub(r"\b\w+(?=(\[[^\]]*\])?$)", "", text, count=1).replace(" [", "[").strip()
    return re.sub(r"\[\d+\]$", "[work]", kind) if re.search(r"\bwork\[", text) else kind
