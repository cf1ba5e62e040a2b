/* What this core can do at most: nanoseconds a lane of FMA, sqrt, div, rsqrt14 with two Newton steps, and of all the
 * arithmetic of one member's force: with everything in registers and nothing waiting, and from the level 1 cache.
 *
 * Compiled once a width: -DWIDTH=1, 4 or 8 doubles. The empty asm statements make every value look new to the
 * compiler and every result used.
 */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdio.h>
#include <time.h>

#if WIDTH == 8
#include <immintrin.h>
typedef __m512d lanes;
#define ALL(x) _mm512_set1_pd(x)
#define FMA(a, b, c) _mm512_fmadd_pd(a, b, c)
#define FNMA(a, b, c) _mm512_fnmadd_pd(a, b, c)
#define SQRT(a) _mm512_sqrt_pd(a)
#define MAX(a, b) _mm512_max_pd(a, b)
#define RSQRT(a) _mm512_rsqrt14_pd(a)
#elif WIDTH == 4
#include <immintrin.h>
typedef __m256d lanes;
#define ALL(x) _mm256_set1_pd(x)
#define FMA(a, b, c) _mm256_fmadd_pd(a, b, c)
#define FNMA(a, b, c) _mm256_fnmadd_pd(a, b, c)
#define SQRT(a) _mm256_sqrt_pd(a)
#define MAX(a, b) _mm256_max_pd(a, b)
#ifdef __AVX512VL__
#define RSQRT(a) _mm256_rsqrt14_pd(a)
#endif
#else
typedef double lanes;
#define ALL(x) (x)
#define FMA(a, b, c) fma(a, b, c)
#define FNMA(a, b, c) fma(-(a), b, c)
#define SQRT(a) sqrt(a)
#define MAX(a, b) ((a) > (b) ? (a) : (b))
#endif

#if defined(__x86_64__)
#define REGISTER "v"
#else
#define REGISTER "w"
#endif
#define NEW(x) __asm__ volatile("" : "+" REGISTER(x))
#define USED(x) __asm__ volatile("" : : REGISTER(x))

enum { ROUNDS = 15, PARALLEL = 12 };

static double now(void)
{
  struct timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Least time of some rounds, in ns for one lane of one operation. */
#define REPORT(title, operations, body) \
  do { \
    double best = 1e30; \
    for (int round = 0; round < ROUNDS; ++round) { \
      const long count = 4000; \
      const double started = now(); \
      for (long k = 0; k < count; ++k) { body } \
      const double taken = (now() - started) * 1e9 / ((double)count * (operations) * WIDTH); \
      if (taken < best) best = taken; \
    } \
    printf("%s %.6f\n", title, best); \
  } while (0)

#define UNROLL _Pragma("GCC unroll 12")
#define EACH(expression) \
  UNROLL \
  for (int p = 0; p < PARALLEL; ++p) { \
    lanes x = start, result; \
    NEW(x); \
    result = expression; \
    USED(result); \
  }

#ifdef RSQRT
static inline lanes newton(lanes square)
{
  const lanes half = square * ALL(0.5);
  lanes y = RSQRT(square);
  y = y * FNMA(half, y * y, ALL(1.5));
  return y * FNMA(half, y * y, ALL(1.5));
}
#endif

/* d = r_i - r_j; t/l = max(0, mu - mu rho / l); f_i -= t/l d; f_j += t/l d */
#define MEMBER(inverse_length) \
  UNROLL \
  for (int p = 0; p < 2; ++p) { \
    lanes a = start, b = start, c = start, i = start, j = start, k = start; \
    NEW(a); NEW(b); NEW(c); NEW(i); NEW(j); NEW(k); \
    a = i - a; b = j - b; c = k - c; \
    const lanes square = FMA(a, a, FMA(b, b, c * c)); \
    const lanes density = MAX(ALL(0.0), FNMA(spring, inverse_length, stiff)); \
    lanes f0 = FNMA(density, a, start), f1 = FNMA(density, b, start), f2 = FNMA(density, c, start); \
    lanes g0 = FMA(density, a, start), g1 = FMA(density, b, start), g2 = FMA(density, c, start); \
    USED(f0); USED(f1); USED(f2); USED(g0); USED(g1); USED(g2); \
  }

/* The same with node positions and forces in the level 1 cache, node p to node p + APART. */
#define CACHED(inverse_length) \
  for (int p = 0; p < MEMBERS; ++p) { \
    const lanes *r = position[p], *s = position[p + APART]; \
    lanes *f = force[p], *g = force[p + APART]; \
    const lanes a = r[0] - s[0], b = r[1] - s[1], c = r[2] - s[2]; \
    const lanes square = FMA(a, a, FMA(b, b, c * c)); \
    const lanes density = MAX(ALL(0.0), FNMA(spring, inverse_length, stiff)); \
    f[0] = FNMA(density, a, f[0]); f[1] = FNMA(density, b, f[1]); f[2] = FNMA(density, c, f[2]); \
    g[0] = FMA(density, a, g[0]); g[1] = FMA(density, b, g[1]); g[2] = FMA(density, c, g[2]); \
  } \
  __asm__ volatile("" : : : "memory");

enum { MEMBERS = 48, APART = 6 };
static lanes position[MEMBERS + APART][3], force[MEMBERS + APART][3];

int main(void)
{
  lanes start = ALL(1.37), spring = ALL(0.5), stiff = ALL(2.0);
  const double begun = now();
  while (now() - begun < 0.1) EACH(FMA(x, x, x))
  NEW(start); NEW(spring); NEW(stiff);
  for (int p = 0; p < MEMBERS + APART; ++p) {
    for (int axis = 0; axis < 3; ++axis) position[p][axis] = ALL(0.1 * p * p + axis);
  }
  REPORT("fma", PARALLEL, EACH(FMA(x, x, x)));
  REPORT("sqrt", PARALLEL, EACH(SQRT(x)));
  REPORT("div", PARALLEL, EACH(ALL(1.0) / x));
  REPORT("member_sqrt_div", 2, MEMBER(ALL(1.0) / SQRT(square)));
  REPORT("cached_sqrt_div", MEMBERS, CACHED(ALL(1.0) / SQRT(square)));
#ifdef RSQRT
  REPORT("rsqrt_newton", PARALLEL, EACH(newton(x)));
  REPORT("member_rsqrt", 2, MEMBER(newton(square)));
  REPORT("cached_rsqrt", MEMBERS, CACHED(newton(square)));
#endif
  return 0;
}
