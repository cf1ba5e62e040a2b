"""C text of vectors of four members: the plain C of `templates/c/lanes.h`, then kernels of members."""

from collections.abc import Sequence

from tensegrity_codegen.codegen.lanes.kernel import DensityKernel
from tensegrity_codegen.codegen.print.render import render


def emit_kernels(kernels: Sequence[DensityKernel], *, in_loops: bool) -> list[str]:
    """Return the lines that stand before functions that use kernels of four members.

    kernels: the kernels, each with a name of its own.
    in_loops: whether they stand in loops, which add to arrays in memory and have a form without vectors; else
        in straight-line code, whose vectors are single numbers where a machine has no vectors.
    """
    context = {
        "kernels": list(kernels),
        "name": "",
        "NAME": "",
        "real": "double",
        "suffix": "",
        "settings": {
            "WITH_FLOAT": False,
            "WITH_LOOPS": in_loops,
            "WITH_BLOCKS": any(kernel.stores for kernel in kernels) and in_loops,
        },
    }
    return render("lanes.c", context).splitlines()
