"""Libraries made quickly, where a test is about neither bits nor speed nor what a scene leaves out.

A compiler that keeps IEEE arithmetic gives the same bits at every level; that ours do so at the levels that
users get is checked by the tests marked `optimised`. The rows of what a scene leaves out, for which every
function of variants of the scene is built, take most of the time of emission and change no line of C.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from unittest import mock

from tensegrity_codegen.codegen import emit
from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS

# The sanitizers see every access that the source makes, and compile in a quarter of the time.
SANITIZE = ("-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


@contextmanager
def without_optimisation() -> Iterator[None]:
    """Within it the flags `reference` do not optimise, and manifests have no rows of what is left out.

    Nor are libraries loaded once in a process of its own before they are stored: tests load them anyway.
    Libraries have keys of their own in the cache.
    """
    usual = FLAG_SETS["reference"]
    quick = replace(usual, options=(*usual.options, "-O0"))
    with (
        mock.patch.dict(FLAG_SETS, reference=quick),
        mock.patch.object(emit, "account_left_out", return_value=()),
        mock.patch("tensegrity_codegen.pipeline.compile_source.check_library"),
    ):
        yield
