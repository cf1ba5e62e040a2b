"""The page docs/controllers_in_c.md: its program fits the headers, its table has every status.

tests/cli/test_blocks.py runs the whole path from the scene to the program.
"""

import re
from pathlib import Path

from tensegrity_codegen.control.embedded.build_controller import ControllerBundle
from tensegrity_codegen.control.embedded.parts import CONTROL_STATUS
from tests.codegen.build_c import STRICT, run
from tests.codegen.compilers import require_compiler

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "controllers_in_c.md").read_text(encoding="utf-8")


def test_the_program_compiles_without_warnings(bundle: ControllerBundle, tmp_path: Path) -> None:
    (tmp_path / "loop.c").write_text(PAGE.split("```c\n")[1].split("```")[0], encoding="utf-8")
    headers = [f"-I{bundle.folder}", f"-I{ROOT / 'generated' / 'pinned_prism'}"]
    run([*require_compiler("gcc").command, *STRICT, "-fsyntax-only", *headers, "loop.c"], tmp_path)


def test_the_page_lists_every_status_with_its_number() -> None:
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \|", PAGE, re.MULTILINE)
    assert rows == [(str(k), word.upper()) for k, word in enumerate(CONTROL_STATUS)]


def test_the_header_numbers_the_statuses_alike(bundle: ControllerBundle) -> None:
    text = (bundle.folder / "pinned_prism_control.h").read_text(encoding="utf-8")
    for number, word in enumerate(CONTROL_STATUS):
        assert f"  PINNED_PRISM_CONTROL_{word.upper()} = {number}" in text
    assert [bundle.load().status_text(k) for k in range(3)] == list(CONTROL_STATUS.values())[:3]
