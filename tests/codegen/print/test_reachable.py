"""C text without what nothing exported reaches."""

from tensegrity_codegen.codegen.print.reachable import drop_unreached, split_definitions

SOURCE = """\
/* banner */
#include "a.h"

#include <limits.h>
#include <string.h>

#define PLAIN
#define TWICE(x) \\
  (2 * (x))
#define HIDDEN __attribute__((always_inline)) static inline
#if defined(__AVX__)
#define WIDE 4
#else
#define WIDE 2
#endif

/* Sizes. */
enum {
  N = 3, /* coordinates */
  N_STATES = 2 * N,
  N_SPARE = 7, /* of nothing */
};
enum { FIRST = 1, SECOND };
typedef char fits[sizeof(int) <= 8 ? 1 : -1];
typedef struct {
  int one; /* spare() { */
} pair;
typedef double row __attribute__((vector_size(WIDE * sizeof(double)), may_alias));
static const double unused_table[2] = {1.0, 2.0};
static const double table[2] = {1.0, 2.0};

/* Two forms of one function. */
#if WIDE == 4
HIDDEN double width(const row *a) { return (*a)[0]; }
#else
HIDDEN double width(const row *a)
{
  return (*a)[1];
}
#endif

#ifdef NOTHING
/* Goes, and its group. */
static int spare(void) { return N_SPARE; }
#endif

static const struct {
  int a, b;
} rows[] = {
    {1, 2}};

/* Calls itself only. */
static int circle(int k) { return k > 0 ? circle(k - 1) : INT_MAX; }

PLAIN int a_compute(double *x)
{
  PLAIN
  row a = {table[0]};
  const pair p = {rows[0].a};
#if defined(SMALL)
  memset(x, 0, N * sizeof *x);
#endif
  x[N_STATES - 1] = width(&a) + p.one;
  return TWICE(1); /* circle(1), "spare" */
}

const char a_text[] = "circle("
#if defined(MORE)
    "SECOND"
#endif
    ;
"""
DROPPED = ("N_SPARE", "FIRST", "unused_table", "spare", "NOTHING", "Calls itself", "limits.h", "PLAIN")


def test_only_what_is_reached_stays() -> None:
    text = drop_unreached(SOURCE)
    for word in DROPPED:
        assert word not in text.replace('circle(1), "spare"', "").replace("spare() {", ""), word
    code = text.replace("circle(1)", "").replace('"circle("', "")
    assert "circle" not in code
    reached = ("string.h", "WIDE 2", "WIDE 4", "N = 3, /* coordinates */", "} pair;", "row", "table[2]")
    for word in (
        *reached,
        "fits",
        "} rows[]",
        "TWICE",
        "(*a)[0]",
        "(*a)[1]",
        "Two forms",
        "a_text",
        "banner",
    ):
        assert word in text, word
    assert "  N_STATES = 2 * N\n};" in text, "no comma at the end"
    assert "\nint a_compute(double *x)\n{\n  row a" in text, "a macro that is nothing goes"


def test_a_name_that_others_use_stays() -> None:
    text = drop_unreached(SOURCE, ["circle", "PLAIN"])
    assert "/* Calls itself only. */\nstatic int circle(int k)" in text
    assert "#include <limits.h>" in text
    assert "PLAIN int a_compute" in text


def test_nothing_is_lost_where_all_is_reached() -> None:
    pieces = list(split_definitions(SOURCE))
    assert "".join(piece.lead + piece.text for piece in pieces) == SOURCE
    names = {name for piece in pieces for name in piece.names}
    text = drop_unreached(SOURCE, names)
    assert text.split() == SOURCE.replace("= 7,", "= 7").split()


def test_what_is_no_definition_stays() -> None:
    source = '#ifdef __cplusplus\nextern "C" {\n#endif\nint f(void);\n#ifdef __cplusplus\n}\n#endif\n'
    assert drop_unreached(source) == source
    assert drop_unreached("#if A\n#error no\n#endif\n") == "#if A\n#error no\n#endif\n"
    assert drop_unreached("static int a;\n") == ""
    used = "__attribute__((used)) static int (*choose(void))(void)\n{\n  return f;\n}\n"
    assert drop_unreached(f"static int f(void) {{ return 1; }}\n{used}").startswith("static int f")
