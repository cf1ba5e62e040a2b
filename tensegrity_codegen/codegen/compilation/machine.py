"""Instruction sets beyond the baseline of an architecture: what a compilation may use, how a machine says so.

Intel and AMD number them by CPUID leaf, part, register and bit (Intel SDM 2A, CPUID; AMD APM 3, appendix E);
the registers of AVX and AVX-512 have to be kept by the operating system too (XCR0).
"""

import re
from dataclasses import dataclass

ECX, EBX, EAX, EDX = 2, 1, 0, 3
YMM, ZMM = 0x06, 0xE6  # bits of XCR0
EXTENDED = 0x80000001


@dataclass(frozen=True)
class InstructionSet:
    """One instruction set of x86: name as compilers say it after -m, and where CPUID answers for it.

    word: 0 to 3 for EAX, EBX, ECX, EDX; state: bits of XCR0 that have to be set too, 0 for none.
    """

    name: str
    leaf: int
    part: int
    word: int
    bit: int
    state: int = 0

    @property
    def macro(self) -> str:
        """What compilers define where they may use it."""
        return f"__{self.name.replace('.', '_').upper()}__"


INSTRUCTION_SETS = (
    InstructionSet("sse3", 1, 0, ECX, 0),
    InstructionSet("ssse3", 1, 0, ECX, 9),
    InstructionSet("sse4.1", 1, 0, ECX, 19),
    InstructionSet("sse4.2", 1, 0, ECX, 20),
    InstructionSet("movbe", 1, 0, ECX, 22),
    InstructionSet("popcnt", 1, 0, ECX, 23),
    InstructionSet("avx", 1, 0, ECX, 28, YMM),
    InstructionSet("f16c", 1, 0, ECX, 29, YMM),
    InstructionSet("fma", 1, 0, ECX, 12, YMM),
    InstructionSet("bmi", 7, 0, EBX, 3),
    InstructionSet("bmi2", 7, 0, EBX, 8),
    InstructionSet("lzcnt", EXTENDED, 0, ECX, 5),
    InstructionSet("xop", EXTENDED, 0, ECX, 11, YMM),
    InstructionSet("fma4", EXTENDED, 0, ECX, 16, YMM),
    InstructionSet("avx2", 7, 0, EBX, 5, YMM),
    InstructionSet("avxvnni", 7, 1, EAX, 4, YMM),
    InstructionSet("avx512f", 7, 0, EBX, 16, ZMM),
    InstructionSet("avx512dq", 7, 0, EBX, 17, ZMM),
    InstructionSet("avx512ifma", 7, 0, EBX, 21, ZMM),
    InstructionSet("avx512pf", 7, 0, EBX, 26, ZMM),
    InstructionSet("avx512er", 7, 0, EBX, 27, ZMM),
    InstructionSet("avx512cd", 7, 0, EBX, 28, ZMM),
    InstructionSet("avx512bw", 7, 0, EBX, 30, ZMM),
    InstructionSet("avx512vl", 7, 0, EBX, 31, ZMM),
    InstructionSet("avx512vbmi", 7, 0, ECX, 1, ZMM),
    InstructionSet("avx512vbmi2", 7, 0, ECX, 6, ZMM),
    InstructionSet("avx512vnni", 7, 0, ECX, 11, ZMM),
    InstructionSet("avx512bitalg", 7, 0, ECX, 12, ZMM),
    InstructionSet("avx512vpopcntdq", 7, 0, ECX, 14, ZMM),
    InstructionSet("avx512fp16", 7, 0, EDX, 23, ZMM),
    InstructionSet("avx512bf16", 7, 1, EAX, 5, ZMM),
)

MARK = re.compile(rb"instruction sets:((?: [a-z0-9.]+)*)\0")


def find_instruction_sets(library: bytes) -> tuple[str, ...]:
    """Return the instruction sets beyond the baseline that a compiled library says it may use."""
    found = MARK.search(library)
    return tuple(found[1].decode("ascii").split()) if found else ()
