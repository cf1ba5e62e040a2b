"""Long verbs that were interrupted or killed go on where they stopped, and say so."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tensegrity_codegen.report.pages.page import Section
from tensegrity_codegen.studies import study
from tensegrity_codegen.studies.papers.sk import chapter
from tensegrity_codegen.studies.stability import report
from tensegrity_codegen.system import forked
from tests.cli.conftest import Run
from tests.cli.test_processes import environment
from tests.codegen.compilers import POSIX, is_running, wait_until

ADVICE = "made keeps what is finished; the same command goes on from there"
SECTIONS = ("inverse", "pattern", "storage", "trajectory", "drift", "offset")
# The verb `reproduce` with sections that take no time, until one has been reached that never ends.
REPRODUCE = """
import signal, sys, time
from pathlib import Path
from tensegrity_codegen.studies.papers.sk import chapter
from tensegrity_codegen.report.pages.page import Section
from tensegrity_codegen.cli.supervised import main

def build(name):
    if name == "storage" and Path("stops").exists():
        if Path("stops").read_text() == "deaf":  # as a long call into C
            signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGUSR1])
        Path("reached").touch()
        time.sleep(600.0)
    return Section(name, "Fig. 0", "Nothing", "new", "nothing", ())

for name in {sections}:
    setattr(chapter, name + "_section", lambda *_, name=name: build(name))
main()
""".replace("{sections}", repr(SECTIONS))
# The verb `stability` with three cases, of which the second one never ends.
STABILITY = """
import os, time
from pathlib import Path
from tensegrity_codegen.studies.stability import report
from tensegrity_codegen.cli.supervised import main

generate, run = report.generate_cases, report.run_case
chosen = []

def few(structure, t_end):
    chosen[:] = list(generate(structure, t_end))[:3]
    return chosen

def work(models, case, limits):
    if case.name != chosen[0].name and Path("stops").exists():
        (Path("reached") / str(os.getpid())).touch()
        time.sleep(600.0)
    return run(models, case, limits)

report.generate_cases, report.run_case = few, work
main()
"""


def start(script: str, *words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", script, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
        start_new_session=True,
    )


def wait_for(process: subprocess.Popen[str], condition: Callable[[], bool]) -> None:
    """Wait until a process has come that far."""
    wait_until(lambda: condition() or process.poll() is not None, "the work has begun", 300.0)
    assert process.poll() is None, process.communicate()


def finish(script: str, *words: str) -> tuple[Any, str]:
    """Return the JSON and the stderr of a run that ends well."""
    process = start(script, *words, "--json")
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    return json.loads(out), err


def patch_sections(monkeypatch: pytest.MonkeyPatch, stops_at: str) -> list[str]:
    """Let sections take no time, and Ctrl-C come in one of them; return the list of those that are built."""
    built: list[str] = []

    def build(name: str) -> Section:
        built.append(name)
        if name == stops_at:
            raise KeyboardInterrupt
        return Section(name, "Fig. 0", "Nothing", "new", "nothing", ())

    for name in SECTIONS:
        monkeypatch.setattr(chapter, f"{name}_section", lambda *_, name=name: build(name))
    return built


def test_an_interrupted_verb_says_how_to_go_on_and_goes_on(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("reproduce", "sk", "--quick", "--out", "made")
    patch_sections(monkeypatch, "storage")
    ended = run(*words)
    assert (ended.code, ended.out) == (130, "")
    assert ended.err.splitlines() == [ADVICE, "interrupted"]
    assert [path.name for path in Path("made").iterdir()] == ["journal"]
    built = patch_sections(monkeypatch, "")
    ended = run(*words, "--json")
    (resumed,) = ended.data["resumed"]
    assert (resumed["taken"], resumed["total"], resumed["what"]) == (2, 6, "sections")
    assert "S&K: 2 of 6 sections taken from the unfinished run of" in ended.err
    assert built == list(SECTIONS[2:])
    assert run(*words).code == 2  # the result files exist
    ended = run(*words, "--overwrite")
    assert "all 6 sections taken from the run of" in ended.err
    assert "; --fresh computes them again" in ended.err
    built = patch_sections(monkeypatch, "")
    assert run(*words, "--fresh", "--overwrite", "--json").data["resumed"] == []
    assert built == list(SECTIONS)


@pytest.mark.thorough
@POSIX
@pytest.mark.parametrize("hears", ["hears", "deaf"])
def test_after_ctrl_c_the_same_command_goes_on(hears: str, folder: Path) -> None:
    words = ("reproduce", "sk", "--quick", "--out", "made")
    Path("stops").write_text(hears)
    process = start(REPRODUCE, *words)
    wait_for(process, lambda: Path("reached").exists())
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, "")
    lines = [line for line in err.splitlines() if " after " not in line and "so far" not in line]
    assert lines == [ADVICE, "interrupted"]
    assert [path.name for path in Path("made").iterdir()] == ["journal"]
    Path("stops").unlink()
    data, err = finish(REPRODUCE, *words)
    (resumed,) = data["resumed"]
    assert (resumed["taken"], resumed["total"], resumed["what"]) == (2, 6, "sections")
    assert "2 of 6 sections taken from the unfinished run of" in err


@pytest.mark.thorough
@POSIX
@pytest.mark.skipif(sys.platform != "linux", reason="needs prctl of Linux")
def test_killed_processes_leave_whole_results_and_no_process(folder: Path, two_nodes: Path) -> None:
    words = ("stability", two_nodes.name, "--t-end", "0.1", "--no-peers", "--limit", "60", "--out", "made")
    Path("stops").touch()
    Path("reached").mkdir()
    process = start(STABILITY, *words)
    journal = Path("made", "journal", "two_nodes.jsonl")
    wait_for(process, lambda: journal.exists() and any(Path("reached").iterdir()))
    os.kill(process.pid, signal.SIGKILL)
    process.communicate(timeout=60)
    for item in Path("reached").iterdir():
        wait_until(lambda item=item: not is_running(int(item.name)), "no case runs any more")  # type: ignore[misc]
    assert [path.name for path in Path("made").iterdir()] == ["journal"]
    Path("stops").unlink()
    data, err = finish(STABILITY, *words)
    (resumed,) = data["resumed"]
    assert (resumed["taken"], resumed["total"], resumed["what"]) == (1, 3, "cases")
    assert "two_nodes: 1 of 3 cases taken from the unfinished run of" in err
    assert data["not_run"] == []


@pytest.mark.thorough
@pytest.mark.skipif(not forked.can_fork(), reason="this system makes no processes by fork")
def test_results_of_another_scene_or_code_are_not_used(
    run: Run, two_nodes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    generate = report.generate_cases
    monkeypatch.setattr(report, "generate_cases", lambda *given: list(generate(*given))[:1])
    words = ("stability", two_nodes, "--t-end", "0.1", "--no-peers", "--limit", "60", "--overwrite", "--json")
    assert run(*words).data["resumed"] == []
    assert [item["taken"] for item in run(*words).data["resumed"]] == [1]
    assert run(*words, "--fresh").data["resumed"] == []
    changed = run(*words, "--limit", "50")
    assert changed.data["resumed"][0]["taken"] == 0
    assert "are not used: scene, options, code, packages or machine differ" in changed.err
    text = two_nodes.read_text(encoding="utf-8")
    two_nodes.write_text(text.replace("spring_constant = 80", "spring_constant = 81"), encoding="utf-8")
    assert run(*words).data["resumed"][0]["taken"] == 0
    two_nodes.write_text(text, encoding="utf-8")
    monkeypatch.setattr(study, "_surroundings", lambda: ("another version",))
    assert run(*words).data["resumed"][0]["taken"] == 0
