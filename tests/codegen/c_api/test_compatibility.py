"""Headers of one version of the C interface only gain: those kept, without comments, stand in today's."""

import re
from pathlib import Path

import pytest

from tensegrity_codegen.tables.manifest import C_API_VERSION
from tests.codegen.c_api.header_rule import find_breaks, read_interface
from tests.codegen.c_api.headers import HEADERS

HERE = Path(__file__).resolve().parent
KEPT = HERE / f"version_{C_API_VERSION}"


@pytest.mark.parametrize("name", HEADERS)
def test_todays_header_has_all_of_the_kept_one(name: str) -> None:
    """A break needs a new version of the interface, and headers of its own here."""
    kept = (KEPT / f"{name}.h").read_text(encoding="utf-8")
    assert find_breaks(kept, HEADERS[name]()) == []


@pytest.mark.parametrize("name", HEADERS)
def test_functions_of_version_2_keep_names_and_arguments(name: str) -> None:
    """Constants and fields that belong to the integrator may differ, see docs/c_api.md."""
    old = (HERE / "version_2" / f"{name}.h").read_text(encoding="utf-8")
    assert [line for line in find_breaks(old, HEADERS[name]()) if line.startswith("functions")] == []
    structs = read_interface(HEADERS[name]()).structs
    for struct, fields in read_interface(old).structs.items():
        of_caller = fields[: fields.index("int is_started")] if "int is_started" in fields else fields
        assert structs[struct][: len(of_caller)] == of_caller


def test_the_kept_headers_have_every_kind_of_declaration() -> None:
    found = read_interface((KEPT / "braced.h").read_text(encoding="utf-8"))
    assert found.constants["BRACED_NON_FINITE_INPUT"] == "1"
    assert found.macros == {"BRACED_C_API_VERSION": "3"}
    assert found.arrays["braced_member_name"] == "char[6][3]"
    assert found.arrays["braced_descriptor"] == "braced_description"
    assert found.functions["braced_status_text"] == "const char * (int)"
    assert "const double" in found.functions["braced_compute_acceleration"]
    assert found.structs["braced_event"] == ["double time", "int kind", "int which", "int direction"]
    assert len(found.functions) > 60


COORDINATE = r"const double coordinate\[8\]"
CHANGES = {
    "a function is gone": (r"BRACED_API int braced_compute_elastic_energy\([^;]*;", "", "functions"),
    "an argument has another length": (COORDINATE, "const double coordinate[9]", "functions"),
    "an argument has another type": (COORDINATE, "const float coordinate[8]", "functions"),
    "a result has another length": (r"double kinetic_energy\[1\]", "double kinetic_energy[2]", "functions"),
    "a status has another number": ("BRACED_NULL_POINTER = 4", "BRACED_NULL_POINTER = 5", "constants"),
    "an index is gone": (r"  BRACED_NODE_n0 = 0,\n", "", "constants"),
    "an array has another type": (
        "const int braced_coordinate_n",
        "const long braced_coordinate_n",
        "arrays",
    ),
    "a field is gone": ("  int kind;\n", "", "structs"),
    "fields change places": ("  int kind;\n  int which;", "  int which;\n  int kind;", "structs"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_that_breaks_programs_is_found(change: str) -> None:
    kept = (KEPT / "braced.h").read_text(encoding="utf-8")
    pattern, replacement, kind = CHANGES[change]
    changed = re.sub(pattern, replacement, kept)
    assert changed != kept
    breaks = find_breaks(kept, changed)
    assert breaks
    assert all(line.startswith(kind) for line in breaks)


def test_additions_and_other_work_memory_break_nothing() -> None:
    kept = (KEPT / "braced.h").read_text(encoding="utf-8")
    more = kept.replace("  int direction;\n", "  int direction;\n  int number;\n")
    more = more.replace("#ifdef __cplusplus\n}", "BRACED_API int braced_new(void);\n#ifdef __cplusplus\n}")
    work = re.search(r"BRACED_RK4_WORK = (\d+)", kept)
    assert work is not None
    more = more.replace(f"_WORK = {work[1]}", "_WORK = 9999").replace(f"work[{work[1]}]", "work[9999]")
    assert more != kept
    assert find_breaks(kept, more) == []
    assert find_breaks(more, kept) != []
