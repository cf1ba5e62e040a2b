"""Machines to compile for: names, commands, cache keys, and refusals; nothing is compiled here."""

import struct
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from tensegrity_codegen.codegen.compilation import toolchain
from tensegrity_codegen.codegen.compilation.flags import (
    FLAG_SETS,
    Compiler,
    build_command,
    describe_toolchain,
)
from tensegrity_codegen.codegen.compilation.toolchain import check_foreign_library, find_cross_compiler
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.binaries import describe_binary
from tensegrity_codegen.system.errors import (
    CompileError,
    CompilerMissingError,
    FormulationError,
    LibraryError,
    UnknownNameError,
)
from tensegrity_codegen.tables.request import ModelRequest
from tensegrity_codegen.tables.targets import TARGETS, find_host, find_system, find_target, library_file_name
from tests.runtime.build import prism

REFERENCE = FLAG_SETS["reference"]
ZIG = Compiler("zig", ("python", "-m", "ziglang", "cc"), "0.17.1")
GCC = Compiler("gcc", ("gcc",), "gcc 12")
REQUEST = ModelRequest(("member_tension",))


def elf(machine: int) -> bytes:
    return b"\x7fELF\x02\x01\x01" + bytes(9) + struct.pack("<HH", 3, machine) + bytes(40)


def pe(machine: int) -> bytes:
    return b"MZ" + bytes(58) + struct.pack("<I", 64) + b"PE\0\0" + struct.pack("<H", machine)


def archive(*files: tuple[str, bytes]) -> bytes:
    text = b"!<arch>\n"
    for name, data in files:
        head = f"{name:<16}{0:<12}{0:<6}{0:<6}{644:<8}{len(data):<10}`\n".encode("ascii")
        text += head + data + b"\n" * (len(data) % 2)
    return text


BINARIES = {
    "ELF for aarch64": elf(183),
    "ELF for x86_64": elf(62),
    "ELF for arm": archive(("/", b"odd"), ("//", b"names "), ("prism.o/", elf(40))),
    "ELF for processor 0x2": elf(2),
    "PE for x86_64": pe(0x8664),
    "Mach-O for aarch64": struct.pack("<II", 0xFEEDFACF, 0x0100000C),
    "Mach-O for x86_64": struct.pack("<II", 0xFEEDFACF, 0x01000007),
    "WebAssembly": b"\0asm\1\0\0\0",
}


@pytest.mark.parametrize(("what", "data"), BINARIES.items(), ids=BINARIES)
def test_a_binary_says_what_machine_it_is_for(what: str, data: bytes) -> None:
    assert describe_binary(data) == what


def test_each_target_makes_a_binary_that_is_known() -> None:
    assert {target.binary for target in TARGETS.values()} <= set(BINARIES)


@pytest.mark.parametrize("whole", [*BINARIES.values(), b"text"], ids=[*BINARIES, "text"])
def test_a_part_of_a_binary_is_described_or_is_none(whole: bytes) -> None:
    for length in range(len(whole)):
        assert describe_binary(whole[:length]) in {"", describe_binary(whole)}


def test_the_running_python_is_a_binary_of_this_machine() -> None:
    if find_host() not in TARGETS:
        pytest.skip(f"{find_host()} is no target")
    assert describe_binary(Path(sys.executable).read_bytes()) in {TARGETS[find_host()].binary, ""}


@pytest.mark.parametrize(
    ("name", "file_name"),
    [
        ("aarch64-linux", "libprism.so"),
        ("x86_64-linux", "libprism.so"),
        ("x86_64-windows", "prism.dll"),
        ("aarch64-macos", "libprism.dylib"),
        ("x86_64-macos", "libprism.dylib"),
        ("wasm32", "prism.wasm"),
        ("thumbv7em", "libprism.a"),
    ],
)
def test_each_target_has_its_kind_of_library(name: str, file_name: str) -> None:
    target = find_target(name)
    assert library_file_name("prism", target) == file_name
    command = build_command(ZIG, REFERENCE, ("prism.c",), "prism.o", shared=False, target=target)
    assert command[command.index("-target") + 1].startswith(("aarch64-", "x86_64-", "wasm32-", "thumb-"))
    assert sum(option.startswith("-mcpu=") for option in command) == 1
    assert "-ffp-contract=off" in command


def test_an_archive_is_made_by_zig_of_object_files() -> None:
    command = build_command(ZIG, REFERENCE, ("a.o", "b.o"), "liba.a", target=TARGETS["thumbv7em"])
    assert command == ("python", "-m", "ziglang", "ar", "rcsD", "liba.a", "a.o", "b.o")


def test_no_two_machines_share_a_library_in_the_cache() -> None:
    texts = [describe_toolchain(ZIG, REFERENCE, target) for target in (find_system(), *TARGETS.values())]
    assert len(set(texts)) == len(texts)
    assert describe_toolchain(ZIG, REFERENCE) == texts[0]


def test_an_unknown_target_lists_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="unknown target") as caught:
        build_library(prism(), REQUEST, target="aarch64-linx")
    assert caught.value.allowed == ", ".join(TARGETS)
    assert "'aarch64-linux'" in caught.value.hint


@pytest.mark.parametrize("stated", [True, False])
def test_flags_of_this_machine_are_refused_with_a_target(stated: bool) -> None:
    request = REQUEST if stated else replace(REQUEST, flags="native")
    with pytest.raises(FormulationError, match="the machine at hand") as caught:
        build_library(prism(), request, flags="native" if stated else None, target="wasm32")
    assert caught.value.where == ("flags" if stated else "model.flags")
    assert caught.value.given == "flags native, target wasm32"


def test_another_compiler_is_refused_with_a_target(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(toolchain, "find_compiler", lambda wanted: GCC)
    with pytest.raises(CompilerMissingError, match="compiled by zig") as caught:
        find_cross_compiler(TARGETS["wasm32"], "gcc")
    assert caught.value.given == "target wasm32, compiler gcc"


def test_a_target_without_zig_names_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(toolchain, "_list_compilers", lambda: iter((GCC,)))
    with pytest.raises(CompilerMissingError, match="not installed") as caught:
        find_cross_compiler(TARGETS["wasm32"])
    assert "'.[cc]'" in caught.value.hint


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_library(prism(), REQUEST).export(tmp_path_factory.mktemp("built"))


def foreign() -> str:
    return next(name for name in TARGETS if name != find_host())


def test_a_library_of_another_machine_is_not_loaded(built: Path) -> None:
    model = CompiledModel(built / library_file_name("small"))
    manifest = replace(model.manifest, target=foreign())
    with pytest.raises(LibraryError, match="compiled for another machine") as caught:
        CompiledModel(model.path, manifest)
    assert (caught.value.given, caught.value.allowed) == (foreign(), find_host())


def test_a_library_of_this_machine_by_name_is_loaded(built: Path) -> None:
    model = CompiledModel(built / library_file_name("small"))
    assert CompiledModel(model.path, replace(model.manifest, target=find_host())).has("member_tension")


def test_a_binary_of_another_machine_is_named_when_it_does_not_load(built: Path, tmp_path: Path) -> None:
    here = TARGETS.get(find_host())
    if here is None:
        pytest.skip(f"{find_host()} is no target")
    what, data = next(item for item in BINARIES.items() if item[0] != here.binary)
    path = tmp_path / library_file_name("small")
    path.write_bytes(data)
    manifest = CompiledModel(built / library_file_name("small")).manifest
    with pytest.raises(LibraryError, match="for another machine") as caught:
        CompiledModel(path, manifest)
    assert caught.value.given == what


def test_a_library_that_is_not_what_was_ordered_is_not_kept(built: Path, tmp_path: Path) -> None:
    manifest = CompiledModel(built / library_file_name("small")).manifest
    target, path = TARGETS["aarch64-linux"], tmp_path / "libsmall.so"
    names = [spec.symbol for spec in manifest.functions]
    whole = elf(183) + " ".join([manifest.scene_hash, *names]).encode("ascii")
    path.write_bytes(whole)
    check_foreign_library(path, manifest, target, ZIG)
    for content, reason in (
        (elf(62) + whole[64:], "is ELF for x86_64, and not ELF for aarch64"),
        (whole.replace(manifest.scene_hash.encode("ascii"), b""), "made from another scene"),
        (whole.replace(names[0].encode("ascii"), b""), f"no symbol {names[0]}"),
        (b"text", "no library"),
    ):
        path.write_bytes(content)
        with pytest.raises(CompileError, match=reason):
            check_foreign_library(path, manifest, target, ZIG)
