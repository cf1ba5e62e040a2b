"""What all tests share: the cache of compiled libraries, compilation without optimisation, examples drawn."""

import gc
import os
import shutil
import signal
import sys
import tempfile
import warnings
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import Phase, settings
from platformdirs import user_cache_path

from tensegrity_codegen.system.cache_root import CACHE_VARIABLE, check_parents, make_private
from tensegrity_codegen.system.errors import UnsafeCacheError
from tensegrity_codegen.system.threads import limit_threads
from tests.codegen.quickly import without_optimisation

ROOT = Path(__file__).resolve().parent.parent
FOLDER = pytest.StashKey[str]()


# The default run draws the same few examples every time and shows one that fails as it was drawn.
# HYPOTHESIS_PROFILE=explore draws new and more ones, and looks for a smaller one that fails.
DRAWN = (Phase.explicit, Phase.generate)
settings.register_profile("same", derandomize=True, deadline=None, max_examples=25, phases=DRAWN)
settings.register_profile("explore", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))


def pytest_configure(config: pytest.Config) -> None:
    if hasattr(config, "workerinput"):  # a worker of pytest-xdist has the controller's environment
        return
    # Tests use all cores and their matrices are small: further threads of BLAS would wait for each other.
    limit_threads()
    # Hundreds of tests start Python, which would compile the package each time; pytest rewrites each test.
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # so do shells start what runs in the background
        signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ[CACHE_VARIABLE] = find_folder(config)
    # zig needs seconds to build its C library: that stays from run to run.
    os.environ.setdefault("ZIG_GLOBAL_CACHE_DIR", str(user_cache_path("tensegrity_codegen") / "zig"))


def find_folder(config: pytest.Config) -> str:
    """Return the folder of compiled libraries, which stays from run to run; else one that goes at the end."""
    folder = ROOT / ".cache" / "libraries"
    try:
        check_parents(folder)
        make_private(folder, folder)
    except (UnsafeCacheError, OSError):  # as in a checkout of another user
        config.stash[FOLDER] = tempfile.mkdtemp(prefix="tensegrity_codegen-tests-")
        return config.stash[FOLDER]
    return str(folder)


def pytest_unconfigure(config: pytest.Config) -> None:
    if FOLDER in config.stash:
        shutil.rmtree(config.stash[FOLDER], ignore_errors=True)


def pytest_collection_finish() -> None:
    # Modules and tests stay to the end: the collection after each module need not look at them.
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Skip what needs the source of DAQP where pip cannot download it, as without a network."""
    report = yield
    if report.failed and "MissingSourceError" in report.longreprtext and "daqp==" in report.longreprtext:
        reason = "Skipped: pip cannot download the source of DAQP"
        report.outcome, report.longrepr = "skipped", (str(item.path), item.location[1] or 0, reason)
    return report


def count_open_files() -> int:
    """Return how many descriptors this process has open; 0 where the system does not list them."""
    try:
        return sum(1 for _ in Path("/proc/self/fd").iterdir())
    except OSError:
        return 0


@pytest.fixture(autouse=True)
def opened(request: pytest.FixtureRequest, left_open: list[str]) -> Iterator[None]:
    """Note a test after which more files are open than before."""
    before = count_open_files()
    yield
    if count_open_files() > before:
        left_open.append(request.node.name)


@pytest.fixture(scope="module", autouse=True)
def left_open(request: pytest.FixtureRequest) -> Iterator[list[str]]:
    """Fail a module whose tests leave files open, with the names of these tests.

    Otherwise the warning would fail whichever test runs when Python next collects garbage.
    """
    suspects: list[str] = []
    yield suspects
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ResourceWarning)
        gc.collect()
    gc.freeze()  # what is left stays in caches; the next module need not look at it again
    found = [str(item.message) for item in caught if issubclass(item.category, ResourceWarning)]
    assert not found, f"{request.node.name}: {'; '.join(found)}; left open by: {', '.join(suspects)}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, Any, Any]:
    """Make libraries without optimisation, which takes a third of the time; bits are the same (quickly.py).

    Tests of bits, of speed, of compilation itself or of what is left out are marked `optimised` and make them
    as users do.
    """
    if item.get_closest_marker("optimised"):
        return (yield)
    with without_optimisation():
        return (yield)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-golden", action="store_true", help="rewrite the files kept in generated/")


@pytest.fixture
def update_golden(request: pytest.FixtureRequest) -> bool:
    """Whether kept files are to be rewritten instead of compared."""
    return bool(request.config.getoption("--update-golden"))
