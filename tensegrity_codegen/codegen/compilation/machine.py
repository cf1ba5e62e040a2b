"""Instruction sets beyond the baseline of x86: names for compilers, and the CPUID bits that report each one.

Intel and AMD number them by CPUID leaf, subleaf, register and bit (Intel SDM 2A, CPUID; AMD APM 3,
appendix E); the operating system must also save the registers of AVX and AVX-512 (bits of XCR0).
"""

import re
from dataclasses import dataclass

EAX, EBX, ECX, EDX = 0, 1, 2, 3  # result registers of CPUID, numbered as in templates/machine.c.j2
YMM_STATE, ZMM_STATE = 0x06, 0xE6  # bits of XCR0: the system saves registers of AVX, of AVX-512
EXTENDED_LEAF = 0x80000001  # CPUID leaf of extensions by AMD


@dataclass(frozen=True)
class InstructionSet:
    """One instruction set of x86: its name after the compiler option -m, and the CPUID bit that reports it.

    register: 0 to 3 for EAX, EBX, ECX, EDX; saved_state: bits of XCR0 that must be set too, 0 for none.
    """

    name: str
    leaf: int
    subleaf: int
    register: int
    bit: int
    saved_state: int = 0

    @property
    def macro(self) -> str:
        """The macro that compilers define where they may use it."""
        return f"__{self.name.replace('.', '_').upper()}__"


INSTRUCTION_SETS = (
    InstructionSet("sse3", 1, 0, ECX, 0),
    InstructionSet("ssse3", 1, 0, ECX, 9),
    InstructionSet("sse4.1", 1, 0, ECX, 19),
    InstructionSet("sse4.2", 1, 0, ECX, 20),
    InstructionSet("movbe", 1, 0, ECX, 22),
    InstructionSet("popcnt", 1, 0, ECX, 23),
    InstructionSet("avx", 1, 0, ECX, 28, YMM_STATE),
    InstructionSet("f16c", 1, 0, ECX, 29, YMM_STATE),
    InstructionSet("fma", 1, 0, ECX, 12, YMM_STATE),
    InstructionSet("bmi", 7, 0, EBX, 3),
    InstructionSet("bmi2", 7, 0, EBX, 8),
    InstructionSet("lzcnt", EXTENDED_LEAF, 0, ECX, 5),
    InstructionSet("xop", EXTENDED_LEAF, 0, ECX, 11, YMM_STATE),
    InstructionSet("fma4", EXTENDED_LEAF, 0, ECX, 16, YMM_STATE),
    InstructionSet("avx2", 7, 0, EBX, 5, YMM_STATE),
    InstructionSet("avxvnni", 7, 1, EAX, 4, YMM_STATE),
    InstructionSet("avx512f", 7, 0, EBX, 16, ZMM_STATE),
    InstructionSet("avx512dq", 7, 0, EBX, 17, ZMM_STATE),
    InstructionSet("avx512ifma", 7, 0, EBX, 21, ZMM_STATE),
    InstructionSet("avx512pf", 7, 0, EBX, 26, ZMM_STATE),
    InstructionSet("avx512er", 7, 0, EBX, 27, ZMM_STATE),
    InstructionSet("avx512cd", 7, 0, EBX, 28, ZMM_STATE),
    InstructionSet("avx512bw", 7, 0, EBX, 30, ZMM_STATE),
    InstructionSet("avx512vl", 7, 0, EBX, 31, ZMM_STATE),
    InstructionSet("avx512vbmi", 7, 0, ECX, 1, ZMM_STATE),
    InstructionSet("avx512vbmi2", 7, 0, ECX, 6, ZMM_STATE),
    InstructionSet("avx512vnni", 7, 0, ECX, 11, ZMM_STATE),
    InstructionSet("avx512bitalg", 7, 0, ECX, 12, ZMM_STATE),
    InstructionSet("avx512vpopcntdq", 7, 0, ECX, 14, ZMM_STATE),
    InstructionSet("avx512fp16", 7, 0, EDX, 23, ZMM_STATE),
    InstructionSet("avx512bf16", 7, 1, EAX, 5, ZMM_STATE),
)

# The text in a compiled library that lists the sets: see templates/machine.c.j2.
LISTED_SETS = re.compile(rb"instruction sets:((?: [a-z0-9.]+)*)\0")


def find_instruction_sets(library: bytes) -> tuple[str, ...]:
    """Return the instruction sets beyond the baseline that a compiled library says it may use."""
    found = LISTED_SETS.search(library)
    return tuple(found[1].decode("ascii").split()) if found else ()
