"""The module of three.js that live pages contain.

three.js itself is published through npm only. The package NiceGUI, which pip downloads, carries it as one
minified module: all of three.js with its controls of the camera. `make wheel` puts that module into the
wheels of this package (`write_three`); elsewhere it is downloaded once.
"""

import hashlib
import io
import os
import zipfile
from pathlib import Path

from tensegrity_codegen.codegen.print.render import template_folder
from tensegrity_codegen.system.errors import MissingSourceError
from tensegrity_codegen.system.files import replaced
from tensegrity_codegen.system.pinned_file import PinnedFile

THREE_VARIABLE = "TENSEGRITY_CODEGEN_THREE"
THREE_REVISION = "180"
THREE = PinnedFile(
    package="nicegui",
    version="3.18.0",
    file="nicegui-3.18.0-py3-none-any.whl",
    sha256="a2bd51642312d98aab6d8b641245d796ff1b89da5829777170bcc488140c3dcd",
    title="the wheel of NiceGUI, which contains three.js,",
    is_source=False,
    hand=f"`three=PATH` of show and play, or the environment variable {THREE_VARIABLE}",
)
# Of the module as live pages contain it: the bytes of `three.js` that `write_three` writes.
MODULE_SHA256 = "1c1f5f800bad1d669035023f0b265038d25e95501e156dce75b5ebb0f324c9d1"
BUNDLED = ("three.js", "three.LICENCE.txt")
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
    """Return the module of three.js and its licences."""
    named = file or os.environ.get(THREE_VARIABLE) or None
    bundled = None if named else read_bundled()
    return bundled or _unpack(THREE.find(named))


def bundle_folder() -> Path:
    """Return the folder of this package that contains three.js, where it does."""
    return template_folder() / "live" / "three"


def read_bundled() -> tuple[str, str] | None:
    """Return module and licences in this package; None if there are none, or damaged ones."""
    module, licence = (bundle_folder() / name for name in BUNDLED)
    try:
        content = module.read_bytes()
        if hashlib.sha256(content).hexdigest() != MODULE_SHA256:
            return None
        return content.decode("utf-8"), licence.read_text(encoding="utf-8")
    except OSError:
        return None


def write_three(folder: Path | None = None, file: str | Path | None = None) -> Path:
    """Write module and licences into this package, so that its wheel contains them; return the folder."""
    target = folder or bundle_folder()
    texts = _unpack(THREE.find(file or os.environ.get(THREE_VARIABLE) or None))
    target.mkdir(parents=True, exist_ok=True)
    for name, content in zip(BUNDLED, texts, strict=True):
        with replaced(target / name, overwrite=True) as temporary:
            temporary.write_bytes(content.encode("utf-8"))
    return target


def describe_three() -> tuple[bool, str]:
    """Return whether live pages can be written without a network, and the path of three.js."""
    named = os.environ.get(THREE_VARIABLE)
    if named:
        return Path(named).is_file(), f"{THREE_VARIABLE}={named}"
    if read_bundled() is not None:
        return True, "in this package"
    if THREE.is_kept():
        return True, "in the cache"
    return False, f"pip downloads it when a live page is written; without a network: {THREE.hand}"


def _unpack(content: bytes) -> tuple[str, str]:
    """Return module and licences of the wheel that carries them."""
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
