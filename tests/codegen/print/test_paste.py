"""Plain C as it is pasted into a generated source: names, numbers and the branches that settings choose."""

import pytest

from tensegrity_codegen.codegen.print.render import paste_text

SETTINGS = {"WITH_EVENTS": True, "WITH_FLOAT": False}


def pasted(text: str, **settings: bool) -> str:
    return paste_text(text, {"scene": "prism"}, SETTINGS | settings, "float", "f")


def test_guard_and_includes_go() -> None:
    text = '#ifndef A_H\n#define A_H\n#include "config.h"\n#include <math.h>\nint a;\n\n#endif\n'
    assert pasted(text) == "#include <math.h>\nint a;\n"


def test_what_stands_before_the_guard_stays() -> None:
    assert pasted("/* A. */\n#ifndef A_H\n#define A_H\nint a;\n#endif\n") == "/* A. */\nint a;\n"


def test_names_begin_with_that_of_the_scene() -> None:
    assert pasted("scene_run SCENE_OK my_scene_run scene") == "prism_run PRISM_OK my_scene_run scene\n"


def test_numbers_have_the_type_of_the_library() -> None:
    assert pasted("real x = (real)0.5 * (real)1e-30 + (real)k; realm") == (
        "float x = 0.5f * 1e-30f + (float)k; realm\n"
    )


def test_the_compiler_decides_what_is_inline() -> None:
    assert pasted("static inline int a(void)") == "static int a(void)\n"


CHOICE = """\
#if WITH_EVENTS
events
#if defined(__GNUC__)
gnu
#else
other
#endif
#else
none
#endif
#if !WITH_FLOAT
double
#endif
"""


def test_branches_are_chosen_and_those_of_the_compiler_stay() -> None:
    inner = "#if defined(__GNUC__)\ngnu\n#else\nother\n#endif\n"
    assert pasted(CHOICE) == f"events\n{inner}double\n"
    assert pasted(CHOICE, WITH_EVENTS=False, WITH_FLOAT=True) == "none\n"


def test_an_unknown_setting_is_an_error() -> None:
    with pytest.raises(KeyError, match="WITH_WINGS"):
        pasted("#if WITH_WINGS\n#endif\n")
