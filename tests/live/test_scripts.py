"""The scripts of live pages are correct JavaScript, import what there is, and have no outside address."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tensegrity_codegen.live.live_page import live_folder

SCRIPTS = sorted(live_folder().glob("*.js"))
MODULES = [path for path in SCRIPTS if path.stem != "boot"]


def test_modules_import_what_other_modules_export() -> None:
    assert len(MODULES) > 10
    exported = {
        path.stem: set(
            re.findall(r"^export (?:async )?(?:function|class|const) (\w+)", path.read_text(), re.M)
        )
        for path in MODULES
    }
    for path in MODULES:
        text = path.read_text(encoding="utf-8")
        for names, source in re.findall(r"^import \{([^}]*)\} from \"([^\"]+)\";", text, re.M):
            wished = {name.strip() for name in names.split(",") if name.strip()}
            allowed = (
                {"THREE", "OrbitControls"} if source == "three" else exported[source.removeprefix("live/")]
            )
            assert wished <= allowed, (path.name, wished - allowed)
            for name in wished:
                assert len(re.findall(rf"\b{name}\b", text)) > 1, (path.name, name)


def test_nothing_is_fetched() -> None:
    for path in (*SCRIPTS, *live_folder().glob("*.css"), *live_folder().glob("*.j2")):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"https?://|\bfetch\(|XMLHttpRequest|@import|url\((?!#)", text), path.name


@pytest.mark.thorough
@pytest.mark.skipif(shutil.which("node") is None, reason="no node is installed")
def test_every_script_can_be_parsed(tmp_path: Path) -> None:
    for path in SCRIPTS:
        copy = tmp_path / f"{path.stem}.{'js' if path.stem == 'boot' else 'mjs'}"
        copy.write_text(path.read_text(encoding="utf-8"), encoding="utf-8")
        done = subprocess.run(["node", "--check", copy], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
