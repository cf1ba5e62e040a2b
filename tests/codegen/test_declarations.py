"""What cffi has to know of a library is read from its own header."""

from dataclasses import replace

import cffi
import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.source import read_declarations
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.library import LoadedLibrary
from tensegrity_codegen.system.errors import AbiMismatchError, LibraryError
from tests.cases import thorough
from tests.codegen.subjects import bare, everything

HEADER = """\
/* A library. */
#ifndef A_H
#ifdef __cplusplus
extern "C" {
#endif
enum { A_OK = 0, A_N = 3 };
typedef struct {
  double time; /* [s] */
  int kind;
} a_event;
extern A_API const double a_nominal_x[3];
extern A_API const a_description a_descriptor;
A_API int a_compute_y(
    const double x[3],
    double y[2]);
#ifdef __cplusplus
}
#endif
#endif
"""


def test_types_and_functions_stay() -> None:
    assert read_declarations(HEADER).splitlines() == [
        "typedef struct { double time; int kind; } a_event;",
        "extern a_description a_descriptor;",
        "int a_compute_y( const double x[3], double y[2]);",
    ]


@pytest.mark.parametrize("subject", [bare, *thorough(everything)])
def test_every_function_of_the_manifest_is_declared(subject: object) -> None:
    source = emit(*subject())  # type: ignore[operator]
    manifest = source.manifest
    assert manifest.declarations == read_declarations(source.files[f"{manifest.name}.h"])
    cffi.FFI().cdef(manifest.declarations)
    for spec in (*manifest.functions, *manifest.integrators):
        assert f"{spec.symbol}(" in manifest.declarations


def test_manifests_without_them_are_refused() -> None:
    library = build_library(*bare())
    model = library.load()
    with pytest.raises(AbiMismatchError, match="declarations"):
        LoadedLibrary(model.path, replace(model.manifest, declarations=""))
    with pytest.raises(LibraryError, match="damaged"):
        LoadedLibrary(model.path, replace(model.manifest, declarations="int ("))
