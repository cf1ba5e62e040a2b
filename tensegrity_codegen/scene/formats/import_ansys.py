"""Import of the text that TsgFEM writes for ANSYS (APDL): links between keypoints, with areas and prestress.

Read are parameters and their arrays (`es=2e11`, `area(1)=1e-4`), `mp` (ex, dens), `k`, `l`, `sectype`,
`secdata`, `seccontrol`, `lsel` with `latt`, `dk`, `fk` and `acel`; commands of the solution and of pictures
are passed over, all others are listed in a note. A link with tension only is a cable, another one a bar.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tensegrity_codegen.scene.checks.limits import MAX_ENTRIES
from tensegrity_codegen.scene.formats.format import Format
from tensegrity_codegen.scene.formats.imported import (
    ImportResult,
    Network,
    NetworkMember,
    build_result,
    read_text,
)
from tensegrity_codegen.system.errors import InvalidValueError, SceneSyntaxError, UnknownNameError, name_list

MAX_FILE_BYTES = 32 * 2**20  # bytes
MAX_INDEX_DIGITS = 15  # digits
WHAT = "a text of APDL commands"
_ASSIGN = re.compile(r"([A-Za-z_]\w{0,31})\s*(?:\(\s*([^()]+?)\s*\))?\s*=\s*(.+)")
_ABAQUS = re.compile(r"^\s*\*(heading|node|element|part|assembly)\b", re.IGNORECASE | re.MULTILINE)
_ELEMENT = re.compile(r"([A-Za-z_]\w{0,31})\s*(?:\(\s*([^()]+?)\s*\))?")
# Commands that say nothing about the structure.
_PASSED = """
finish et mp *dim *do *enddo inistate *get allsel solve antype nlgeo nlgeom sstif nsubst autots
outres pldisp etable plls lesize lmesh esel nsel plnsol prnsol set /clear /filename /title /prep7
/solu /post1 /post26 /units /eshape /replot time kbc type mat real secnum
"""
PASSED = frozenset(_PASSED.split())
AXES = {"ux": "x", "uy": "y", "uz": "z", "fx": "x", "fy": "y", "fz": "z", "x": "x", "y": "y", "z": "z"}


def import_ansys(
    path: str | Path, *, name: str | None = None, gravity: Sequence[float] | None = None
) -> ImportResult:
    """Return the scene document of an APDL text as TsgFEM writes it, and notes."""
    path = Path(path)
    reader = _Reader(str(path))
    text = read_text(path, MAX_FILE_BYTES, WHAT, fallback="latin-1")
    if keyword := _ABAQUS.search(text):
        problem = "the file is an input of Abaqus or CalculiX, not of ANSYS"
        location = f"{path}: line {text.count(chr(10), 0, keyword.start(1)) + 1}"
        hint = "write its nodes and elements as two tables: nodes.csv and members.csv"
        raise InvalidValueError(problem, where=location, given=keyword[0].strip(), allowed=WHAT, hint=hint)
    for number, line in enumerate(text.split("\n"), start=1):
        reader.read_line(number, line.partition("!")[0].strip())
    return build_result(reader.build(), path, name, gravity)


@dataclass
class _Link:
    ends: tuple[str, str]
    line: int
    material: str = "1"
    section: str = "1"


@dataclass
class _Reader:
    """Statements of the lines of a file so far."""

    file: str
    values: dict[tuple[str, str], float] = field(default_factory=dict)  # name and index, "" for none
    materials: dict[tuple[str, str], float] = field(default_factory=dict)  # property and number
    keypoints: dict[str, list[float]] = field(default_factory=dict)
    links: list[_Link] = field(default_factory=list)
    sections: dict[str, dict[str, float]] = field(default_factory=dict)
    held: dict[str, set[str]] = field(default_factory=dict)
    loads: dict[tuple[str, str], float] = field(default_factory=dict)
    gravity: list[float] | None = None
    section: str = ""
    selected: int | None = None
    unknown: dict[str, int] = field(default_factory=dict)
    line: int = 0

    @property
    def where(self) -> str:
        return f"{self.file}: line {self.line}"

    def read_line(self, number: int, text: str) -> None:
        """Read one line without its comment."""
        self.line = number
        if not text:
            return
        assigned = _ASSIGN.fullmatch(text)
        if assigned and not text.startswith(("*", "/")):
            index = self._index(assigned[2]) if assigned[2] else ""
            self.values[assigned[1].lower(), index] = self.number(assigned[3])
            return
        arguments = [argument.strip() for argument in text.split(",")]
        command = arguments[0].lower() or ","
        handler = getattr(self, f"_{command}", None) if re.fullmatch(r"[a-z]+", command) else None
        if handler is not None and command in COMMANDS:
            handler([*arguments[1:], "", "", "", "", "", ""])
        elif command.split()[0] not in PASSED and not command.startswith(("/title", "/filename")):
            self.unknown[command[:20]] = self.unknown.get(command[:20], 0) + 1
        if len(self.keypoints) + len(self.links) > MAX_ENTRIES:
            problem = "too many nodes and members"
            raise SceneSyntaxError(problem, where=self.where, allowed=f"up to {MAX_ENTRIES}")

    def number(self, text: str) -> float:
        """Return a number, or the value of a parameter."""
        try:
            value = (
                float(text.replace("d", "e").replace("D", "e")) if text[:1] in "+-.0123456789" else math.nan
            )
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            return value
        named = _ELEMENT.fullmatch(text)
        if not named or text[:1] in "+-.0123456789":
            allowed = "a number, a parameter or an element of an array; expressions are not read"
            raise InvalidValueError("not a number", where=self.where, given=text[:80], allowed=allowed)
        key = (named[1].lower(), self._index(named[2]) if named[2] else "")
        if key not in self.values:
            allowed = "a parameter that a line above sets"
            raise UnknownNameError("unknown parameter", where=self.where, given=text[:80], allowed=allowed)
        return self.values[key]

    def _index(self, text: str) -> str:
        """Return a number of a keypoint, section, ... as text: "3" of "3", "3." or a parameter."""
        if text.isdecimal() and len(text) <= MAX_INDEX_DIGITS:
            return str(int(text))
        value = self.number(text)
        if value != int(value) or abs(value) >= 10**MAX_INDEX_DIGITS:
            raise InvalidValueError("not a whole number", where=self.where, given=text[:80])
        return str(int(value))

    def _mp(self, words: list[str]) -> None:
        if words[0].lower() in ("ex", "dens"):
            self.materials[words[0].lower(), self._index(words[1])] = self.number(words[2])

    def _k(self, words: list[str]) -> None:
        name = self._index(words[0])
        if name in self.keypoints:
            raise InvalidValueError("the keypoint is defined twice", where=self.where, given=name)
        self.keypoints[name] = [self.number(argument) if argument else 0.0 for argument in words[1:4]]

    def _l(self, words: list[str]) -> None:
        self.links.append(_Link((self._index(words[0]), self._index(words[1])), self.line))

    def _sectype(self, words: list[str]) -> None:
        self.section = self._index(words[0])
        self.sections[self.section] = {}

    def _secdata(self, words: list[str]) -> None:
        self._current_section()["area"] = self.number(words[0])

    def _seccontrol(self, words: list[str]) -> None:
        self._current_section()["control"] = self.number(words[1]) if words[1] else 0.0

    def _current_section(self) -> dict[str, float]:
        if not self.section:
            raise InvalidValueError("no section is open", where=self.where, allowed="sectype before")
        return self.sections[self.section]

    def _lsel(self, words: list[str]) -> None:
        self.selected = int(self._index(words[3])) if words[0].lower() == "s" and words[3] else None

    def _latt(self, words: list[str]) -> None:
        chosen = self.links if self.selected is None else self.links[self.selected - 1 : self.selected]
        if not chosen or (self.selected is not None and self.selected < 1):
            allowed = f"1 to {len(self.links)}"
            raise InvalidValueError("no such line", where=self.where, given=self.selected, allowed=allowed)
        for link in chosen:
            link.material, link.section = self._index(words[0] or "1"), self._index(words[6] or "1")

    def _dk(self, words: list[str]) -> None:
        label = words[1].lower()
        if label != "all" and label not in ("ux", "uy", "uz"):
            problem, location = "not a displacement", self.where
            raise InvalidValueError(problem, where=location, given=words[1][:20], allowed="UX, UY, UZ or ALL")
        held = self.held.setdefault(self._index(words[0]), set())
        held.update("xyz" if label == "all" else AXES[label])

    def _fk(self, words: list[str]) -> None:
        axis = AXES.get(words[1].lower())
        if axis is None or words[1].lower().startswith("u"):
            problem = "not a force"
            raise InvalidValueError(problem, where=self.where, given=words[1][:20], allowed="FX, FY or FZ")
        self.loads[self._index(words[0]), axis] = self.number(words[2])

    def _acel(self, words: list[str]) -> None:
        self.gravity = [0.0 - self.number(argument) if argument else 0.0 for argument in words[:3]]

    def build(self) -> Network:
        """Return nodes and members."""
        network = Network(gravity=self.gravity)
        for name, position in self.keypoints.items():
            node: dict[str, Any] = {"position": position}
            held = "".join(axis for axis in "xyz" if axis in self.held.get(name, ()))
            node |= {"anchored": True if len(held) == 3 else held} if held else {}
            network.nodes[name] = node
        for name in {*self.held, *(node for node, _ in self.loads)} - self.keypoints.keys():
            problem = "unknown keypoint"
            raise UnknownNameError(problem, where=self.file, given=name, allowed="a keypoint of the file")
        moved = 0.0
        for number, link in enumerate(self.links, start=1):
            moved += self._add_link(network, number, link)
        for loaded in dict.fromkeys(name for name, _ in self.loads):
            force = [self.loads.get((loaded, axis), 0.0) for axis in "xyz"]
            network.loads.append((loaded, force))
        if moved:
            network.notes.append(
                f"cables have no mass here: {moved:g} kg of them is half at each of their nodes"
            )
        if self.loads:
            network.notes.append("all forces act at once: steps of the solution are not read")
        if self.unknown:
            listed = name_list([f"{key} ({count})" for key, count in self.unknown.items()], 10)
            network.notes.append(f"commands that are not read: {listed}")
        return network

    def _add_link(self, network: Network, number: int, link: _Link) -> float:
        """Add a link as a member; return the mass [kg] that it gave to its nodes."""
        where = f"{self.file}: line {link.line}"
        section = self.sections.get(link.section, {})
        area, modulus = section.get("area"), self.materials.get(("ex", link.material))
        if area is None or modulus is None or not area > 0:
            problem = "the line has no section with an area above 0, or no material with a modulus"
            value = f"section {link.section}, material {link.material}"
            allowed = "latt with a material (mp,ex) and a section (secdata)"
            raise InvalidValueError(problem, where=where, given=value, allowed=allowed)
        cable = section.get("control", 0.0) == 1.0
        member: dict[str, Any] = {"kind": "cable" if cable else "bar", "axial_stiffness": modulus * area}
        stress = self.values.get(("prestress", str(number)))
        if stress is not None:
            member["prestress"] = stress * area
        density, moved = self.materials.get(("dens", link.material), 0.0), 0.0
        if density > 0 and not cable:
            member |= {"density": density, "radius": math.sqrt(area / math.pi)}
        elif density > 0 and all(end in self.keypoints for end in link.ends):
            moved = density * area * math.dist(*(self.keypoints[end] for end in link.ends))
            for end in link.ends:
                node = network.nodes[end]
                node["mass"] = node.get("mass", 0.0) + moved / 2
        network.members.append(NetworkMember(f"m{number}", link.ends, member, where))
        return moved


COMMANDS = frozenset(["mp", "k", "l", "sectype", "secdata", "seccontrol", "lsel", "latt", "dk", "fk", "acel"])

FORMAT = Format(
    title="texts of TsgFEM for ANSYS (APDL)", sources=("structure_ansys.txt",),
    endings=(".txt", ".mac", ".inp"), read=import_ansys, order=5,
)  # fmt: skip
