import pytest

from tensegrity_codegen.codegen.compilation.flags import (
    FLAG_SETS,
    Compiler,
    build_command,
    describe_toolchain,
    find_flags,
)
from tensegrity_codegen.system.errors import UnknownNameError
from tensegrity_codegen.tables.targets import find_system, library_file_name

pytestmark = pytest.mark.optimised

GCC = Compiler("gcc", ("gcc",), "gcc 12")
ZIG = Compiler("zig", ("zig", "cc"), "0.13.0")


@pytest.mark.parametrize("flags", FLAG_SETS.values(), ids=FLAG_SETS)
def test_no_flag_set_gives_up_nan_checks_or_contracts(flags):
    command = build_command(GCC, flags, ("a.c",), "liba.so")
    assert not {"-Ofast", "-ffast-math", "-ffinite-math-only"} & set(command)
    assert "-ffp-contract=off" in command


@pytest.mark.parametrize(
    ("system", "file_name", "option", "position"),
    [
        ("linux", "libprism.so", "-shared", True),
        ("darwin", "libprism.dylib", "-dynamiclib", True),
        ("win32", "prism.dll", "-shared", False),
        ("freebsd14", "libprism.so", "-shared", True),
    ],
)
def test_each_system_gets_its_own_kind_of_library(system, file_name, option, position):
    target = find_system(system)
    command = build_command(GCC, FLAG_SETS["reference"], ("a.c",), "out", target=target)
    assert library_file_name("prism", target) == file_name
    assert option in command
    assert ("-fPIC" in command) == position


def test_an_object_is_not_linked():
    command = build_command(GCC, FLAG_SETS["reference"], ("a.c",), "a.o", shared=False)
    assert "-c" in command
    assert not {"-shared", "-dynamiclib", "-lm"} & set(command)


def test_zig_gets_a_portable_cpu_that_native_overrides():
    reference = build_command(ZIG, FLAG_SETS["reference"], ("a.c",), "out")
    native = build_command(ZIG, FLAG_SETS["native"], ("a.c",), "out")
    assert "-mcpu=baseline" in reference
    assert not any(option.endswith("=native") for option in reference)
    this_cpu = next(option for option in native if option.endswith("=native"))
    assert native.index(this_cpu) > native.index("-mcpu=baseline")


def test_unknown_flags_list_the_known_ones():
    with pytest.raises(UnknownNameError, match="unknown compile flags") as caught:
        find_flags("natve")
    assert (caught.value.where, caught.value.given) == ("model.flags", "natve")
    assert "'native'" in caught.value.hint
    assert caught.value.allowed == "reference, native, small"


def test_the_description_tells_toolchains_apart():
    reference, native = FLAG_SETS["reference"], FLAG_SETS["native"]
    newer = Compiler("gcc", ("gcc",), "gcc 13")
    texts = [
        describe_toolchain(*pair)
        for pair in ((GCC, reference), (GCC, native), (newer, reference), (ZIG, reference))
    ]
    assert len(set(texts)) == len(texts)
    assert describe_toolchain(GCC, reference) == texts[0]


def test_native_code_is_tied_to_the_cpu(monkeypatch):
    before = {name: describe_toolchain(GCC, flags) for name, flags in FLAG_SETS.items()}
    monkeypatch.setattr("tensegrity_codegen.codegen.compilation.flags.describe_cpu", lambda: "another")
    after = {name: describe_toolchain(GCC, flags) for name, flags in FLAG_SETS.items()}
    assert after["reference"] == before["reference"]
    assert after["native"] != before["native"]
