"""Bytes of stack along chains of calls of C functions."""

from tensegrity_codegen.codegen.measure import deepest_stack, find_mentions

SOURCE = """
#define TWICE(x) (2 * inner(x)) /* inner("}") */
#ifdef __cplusplus
extern "C" {
#endif
enum kind { first, second };
static const double table[2] = {1.0, 2.0};
static double (*const chosen[])(double) = {inner, other};
static double inner(double x) { char brace = '}'; const char *text = "outer("; return x + table[0]; }
static double other(double x) { return x; }
static double inlined(double x) { return TWICE(x); }
__attribute__((visibility("default"))) double s_outer(double x) {
  if (x > 0) { return inlined(x); }
  return other(x);
}
double s_alone(void) { return 0.0; } // inner(0)
double s_even(int k) { return k ? s_odd(k - 1) : 0; }
double s_odd(int k) { return k ? s_even(k - 1) : 1; }
#ifdef __cplusplus
}
#endif
"""


def test_what_a_body_mentions() -> None:
    mentions = find_mentions([SOURCE])
    assert "inlined" in mentions["s_outer"]
    assert "inner" in mentions["TWICE"]
    assert "inner" not in mentions["s_alone"], "a comment calls nothing"
    assert "outer" not in mentions["inner"], "a text calls nothing"
    assert "kind" not in mentions, "a type is not called"


def test_the_longest_chain_of_calls_counts() -> None:
    frames = {"inner": 100, "other.constprop.0": 10, "s_outer": 16, "s_alone": 4, "s_even": 8, "s_odd": 24}
    found = deepest_stack(frames, [SOURCE])
    assert found["s_outer"] == 16 + 100, "through a function that is inlined and a macro"
    assert found["s_alone"] == 4
    assert found["s_even"] == found["s_odd"] == 32, "a circle counts each of its functions once"
    assert found["other.constprop.0"] == 10


def test_definitions_in_several_files() -> None:
    found = deepest_stack({"a": 1, "b": 2}, ["int a(void) { return b(); }", "int b(void) { return 3; }"])
    assert found == {"a": 3, "b": 2}
