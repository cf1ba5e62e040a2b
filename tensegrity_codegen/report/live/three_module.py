"""The module of three.js that live pages contain.

three.js itself is published through npm only. The package NiceGUI, which pip downloads, carries it as one
minified module: all of three.js with its controls of the camera.
"""

from __future__ import annotations

import io
import os
import zipfile
from pathlib import Path

from tensegrity_codegen.errors import MissingSourceError
from tensegrity_codegen.fetched.pinned import PinnedFile

__all__ = ["LICENCE", "THREE", "THREE_REVISION", "THREE_VARIABLE", "find_three"]

THREE_VARIABLE = "TENSEGRITY_CODEGEN_THREE"
THREE_REVISION = "180"
THREE = PinnedFile(
    package="nicegui",
    version="3.18.0",
    file="nicegui-3.18.0-py3-none-any.whl",
    sha256="a2bd51642312d98aab6d8b641245d796ff1b89da5829777170bcc488140c3dcd",
    title="the wheel of NiceGUI, which contains three.js,",
    is_source=False,
    hand=f"`three=PATH`, or the environment variable {THREE_VARIABLE}",
)
MODULE = "nicegui/elements/scene/dist/index.js"
NOTICE = "nicegui-3.18.0.dist-info/licenses/LICENSE"
LICENCE = """\
three.js, revision {revision}. The MIT License. Copyright 2010-2025 three.js authors.

Permission is hereby granted, free of charge, to any person obtaining a copy of this software and
associated documentation files (the "Software"), to deal in the Software without restriction,
including without limitation the rights to use, copy, modify, merge, publish, distribute,
sublicense, and/or sell copies of the Software, and to permit persons to whom the Software is
furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all copies or substantial
portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT
NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND
NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES
OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM, OUT OF OR IN
CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.

Taken from the module of the package NiceGUI {version} that joins it with Tween.js (MIT), under this licence:

{notice}"""


def find_three(file: str | Path | None = None) -> tuple[str, str]:
    """Return the module of three.js and its licences.

    Parameters
    ----------
    file : path, optional
        The wheel of NiceGUI of the pinned version; by default the file that the environment variable
        TENSEGRITY_CODEGEN_THREE names, the copy in the cache, or what pip downloads.

    Returns
    -------
    module : str
        Text of a JavaScript module that exports THREE and OrbitControls.
    licence : str
        The licences under which it is used.

    Raises
    ------
    MissingSourceError
        The file cannot be read, is another one, or pip cannot download it.
    """
    content = THREE.find(file or os.environ.get(THREE_VARIABLE) or None)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as wheel:
            module, notice = (wheel.read(name).decode("utf-8") for name in (MODULE, NOTICE))
    except (KeyError, zipfile.BadZipFile, UnicodeDecodeError) as error:
        raise MissingSourceError(
            f"{THREE.title} is damaged", where=THREE.file, given=str(error), hint=THREE.hint
        ) from error
    lines = [line for line in module.splitlines() if not line.startswith("//# sourceMappingURL")]
    licence = LICENCE.format(revision=THREE_REVISION, version=THREE.version, notice=notice.strip())
    return "\n".join(lines) + "\n", licence
