"""Source that travels: compiled where it arrives, or the library used that came along with it."""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from tensegrity_codegen.codegen.compilation.cache import Cache
from tensegrity_codegen.pipeline.build_library import BuiltLibrary, build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.sweeps.engines import dask_engine as parcels
from tensegrity_codegen.sweeps.engines.dask_engine import load_parcel, make_parcel
from tensegrity_codegen.system.errors import CompilerMissingError
from tests.sweeps.engines.conftest import SCENE

STATE = [0.0, 0.0, -1.5]


@pytest.fixture(scope="module", params=["reference", "native"])
def built(request: pytest.FixtureRequest) -> BuiltLibrary:
    structure, wanted = load_scene(SCENE)
    return build_library(structure, replace(wanted, flags=request.param))


def find_no_compiler(name: Any) -> NoReturn:
    raise CompilerMissingError("no C compiler was found")


def test_source_is_compiled_once_where_it_arrives(built: BuiltLibrary, tmp_path: Path) -> None:
    flags = _flags_of(built)
    sent = pickle.loads(pickle.dumps(make_parcel(built, flags)))
    cache, structure = Cache(tmp_path / "cache"), built.structure
    assert structure is not None
    model = load_parcel(sent, structure, cache)
    expected = built.load().compute("member_tension", coordinate=STATE)
    assert np.array_equal(model.compute("member_tension", coordinate=STATE), expected)
    assert model.structure is structure
    assert cache.count() == 1
    assert load_parcel(sent, structure, cache).library.path == model.library.path
    # A cache that both have in common holds the library already, under the same key.
    assert model.library.path.parent.name == built.entry.key


def test_without_a_compiler_only_a_portable_library_is_used(
    built: BuiltLibrary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flags, structure = _flags_of(built), built.structure
    assert structure is not None
    sent = make_parcel(built, flags)
    monkeypatch.setattr(parcels, "find_compiler", find_no_compiler)
    cache = Cache(tmp_path / "cache")
    if flags == "native":
        assert sent.library == b""
        with pytest.raises(CompilerMissingError):
            load_parcel(sent, structure, cache)
        return
    model = load_parcel(sent, structure, cache)
    expected = built.load().compute("member_tension", coordinate=STATE)
    assert np.array_equal(model.compute("member_tension", coordinate=STATE), expected)
    with pytest.raises(CompilerMissingError):
        load_parcel(replace(sent, platform="plan9 mips"), structure, cache)


def test_the_second_model_of_stiff_bars_comes_along(built: BuiltLibrary, tmp_path: Path) -> None:
    structure, parcel, cache = (
        built.structure,
        make_parcel(built, _flags_of(built)),
        Cache(tmp_path / "cache"),
    )
    assert structure is not None
    assert load_parcel(parcel, structure, cache).rigid_twin is None
    model = load_parcel(pickle.loads(pickle.dumps(replace(parcel, twin=parcel))), structure, cache)
    assert model.rigid_twin is not None
    assert model.rigid_twin.library.path == model.library.path


def _flags_of(built: BuiltLibrary) -> str:
    return "native" if "native" in built.flags else "reference"
