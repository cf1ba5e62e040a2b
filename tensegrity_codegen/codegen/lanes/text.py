"""C text of vectors of four members: the plain C of `templates/c/lanes.h`, then kernels of members."""

from collections.abc import Sequence

from tensegrity_codegen.codegen.lanes.kernel import DensityKernel
from tensegrity_codegen.codegen.print.render import render


def emit_kernels(kernels: Sequence[DensityKernel], *, adds_blocks: bool) -> list[str]:
    """Return the lines that stand before functions that use kernels of four members.

    Parameters
    ----------
    kernels : sequence of DensityKernel
        The kernels, each with a name of its own.
    adds_blocks : bool
        Whether stiffness blocks are added to a matrix, entry by entry; else they are summed up in vectors
        before they are stored.

    Returns
    -------
    list of str
        Lines of C.
    """
    context = {
        "kernels": list(kernels),
        "name": "",
        "NAME": "",
        "real": "double",
        "suffix": "",
        "settings": {"WITH_FLOAT": False, "WITH_BLOCKS": adds_blocks},
    }
    return render("lanes.c", context).splitlines()
