"""The tables of docs/c_api.md are those of the registries and of a generated header."""

import functools
import re

from tensegrity_codegen.tables.manifest import (
    ABI_VERSION,
    ALL_STATUS,
    C_API_VERSION,
    COPY_STATUS,
    SOLVER_STATUS,
    STATUS,
    STATUS_TEXT,
)
from tensegrity_codegen.tables.quantities import ARGUMENTS
from tensegrity_codegen.tables.quantities.quantity import Quantity
from tests.codegen.c_api.header_rule import Interface, read_interface
from tests.codegen.c_api.headers import HEADERS
from tests.doc_tables import DOCS, check_table

PAGE = "c_api.md"

SIZES = {
    "nodes": "nodes",
    "members": "members",
    "axes": "modelled axes, 1 to 3",
    "coordinates": "free coordinates",
    "states": "numbers of a state: all coordinates, then all velocities",
    "inputs": "inputs and actuators",
    "bar_pairs": "pairs of bars, where a quantity runs over them",
}
KINDS = {
    "node": "nodes",
    "member": "members",
    "coordinate": "free coordinates",
    "input": "inputs and actuators",
    "bar_pair": "pairs of bars",
}


def shape_of(quantity: Quantity) -> str:
    if not quantity.shape:
        return "scalar"
    return "(" + ", ".join(quantity.shape) + ("," if len(quantity.shape) == 1 else "") + ")"


def cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def test_status(update_golden: bool) -> None:
    rows = [
        (f"`NAME_{name.upper()}`", str(number), STATUS_TEXT[name], of)
        for number, (name, of) in enumerate(
            [(name, "") for name in STATUS]
            + [(name, "solvers") for name in SOLVER_STATUS]
            + [(name, "copies") for name in COPY_STATUS]
        )
    ]
    check_table(PAGE, "status", ("constant", "value", "text", "of"), rows, update_golden)
    assert set(STATUS_TEXT) == set(ALL_STATUS)


@functools.cache
def read_header(name: str) -> Interface:
    return read_interface(HEADERS[name]())


def test_sizes(update_golden: bool) -> None:
    numbers = [
        name.partition("_N_") for place in ("braced", "prism") for name in read_header(place).constants
    ]
    assert {last.lower() for first, _, last in numbers if first in ("BRACED", "PRISM") and last} == set(SIZES)
    rows = [(f"`NAME_N_{name.upper()}`", text) for name, text in SIZES.items()]
    check_table(PAGE, "sizes", ("constant", "number of"), rows, update_golden)


def test_names(update_golden: bool) -> None:
    found, pairs = read_header("braced"), read_header("prism")
    arrays = [name for name in (*found.arrays, *pairs.arrays) if name.endswith("_name")]
    assert {name.partition("_")[2].removesuffix("_name") for name in arrays} == set(KINDS)
    for kind in KINDS:
        assert any(f"_{kind.upper()}_" in name for name in (*found.constants, *pairs.constants))
    rows = [(f"`NAME_{kind.upper()}_<name>`", f"`name_{kind}_name[]`", text) for kind, text in KINDS.items()]
    check_table(PAGE, "names", ("index", "table of texts", "of"), rows, update_golden)


def test_arguments(update_golden: bool) -> None:
    rows = [(f"`{item.name}`", shape_of(item), item.unit, cell(item.sentence)) for item in ARGUMENTS.values()]
    check_table(PAGE, "arguments", ("argument", "shape", "unit", "meaning"), rows, update_golden)


STRUCTS = {
    "run": ("name_integrate_..._run", 12),  # the number of fields that are the caller's
    "event": ("name_run", 4),
    "profile": ("name_run", 7),
    "equilibrium_report": ("name_find_equilibrium", 7),
    "description": ("name_descriptor", 7),
}


def test_structs(update_golden: bool) -> None:
    found: dict[str, list[str]] = {}
    for name, interface in ((name, read_header(name)) for name in ("braced", "lin_prism")):
        for struct, fields in interface.structs.items():
            plain = [re.sub(rf"\b{name}_", "name_", field) for field in fields]
            found.setdefault(struct.removeprefix(f"{name}_"), plain)  # with events, where there are any
    assert set(found) == set(STRUCTS)
    rows = [
        (f"`name_{struct}`", f"`{of}`", ", ".join(f"`{field}`" for field in found[struct][:count]))
        for struct, (of, count) in STRUCTS.items()
    ]
    check_table(PAGE, "structs", ("struct", "of", "fields"), rows, update_golden)
    assert found["run"][11] == "const name_profile *profile"


def test_the_page_lists_every_name_of_a_header() -> None:
    words = re.findall(r"`([^`]+)`", (DOCS / PAGE).read_text(encoding="utf-8"))
    for name, interface in ((name, read_header(name)) for name in ("braced", "lin_prism")):
        listed = re.compile("|".join(_pattern(word, name) for word in words if "name" in word.lower()))
        for names in (interface.constants, interface.structs, interface.arrays, interface.functions):
            missing = [item for item in names if not listed.fullmatch(item)]
            assert not missing, missing


def _pattern(word: str, name: str) -> str:
    """Return the names that a word of the page stands for, as a regular expression."""
    bare = re.sub(r"^(?:enum|int) |[(\[].*$", "", word)
    parts = re.split(r"(<name>|QUANTITY|ARGUMENT|METHOD|\.\.\.)", bare)
    text = "".join(r"\w+" if k % 2 else re.escape(part) for k, part in enumerate(parts))
    return re.sub(r"^NAME_", f"{name.upper()}_", re.sub(r"^name_", f"{name}_", text))


def test_the_page_states_the_versions() -> None:
    page = (DOCS / PAGE).read_text(encoding="utf-8")
    assert f"# The C interface, version {C_API_VERSION}" in page
    assert f"the binary layout of structs, {ABI_VERSION};" in page
