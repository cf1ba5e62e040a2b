/* Loops that call a C function many times and return the seconds of processor time it took, all threads;
 * loaded once by runner.py. */
#define _POSIX_C_SOURCE 199309L
#include <stddef.h>
#include <time.h>

/* Not the clock on the wall: others may use this core too. */
static double now(void)
{
  struct timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

#define REPEAT(call) \
  do { \
    const double started = now(); \
    long k; \
    for (k = 0; k < count; ++k) call; \
    return now() - started; \
  } while (0)

typedef const void *in;
typedef void *out;

/* int f(const real *argument, ..., real *result) */
double time_plain(void *f, int n_arguments, const in *a, out result, long count)
{
  switch (n_arguments) {
    case 0: REPEAT(((int (*)(out))f)(result));
    case 1: REPEAT(((int (*)(in, out))f)(a[0], result));
    case 2: REPEAT(((int (*)(in, in, out))f)(a[0], a[1], result));
    default: return -1.0;
  }
}

/* int f(int n_batch, const real *argument, int stride, ..., real *result, int *status) */
double time_batch(void *f, int n_arguments, int n_batch, const in *a, const int *stride, out result, long count)
{
  switch (n_arguments) {
    case 1: REPEAT(((int (*)(int, in, int, out, int *))f)(n_batch, a[0], stride[0], result, NULL));
    case 2:
      REPEAT(((int (*)(int, in, int, in, int, out, int *))f)(
          n_batch, a[0], stride[0], a[1], stride[1], result, NULL));
    default: return -1.0;
  }
}

/* CasADi's interface: int f(const double **arg, double **res, long long *iw, double *w, int mem) */
double time_casadi(void *f, const double **arg, double **res, long long *iw, double *w, long count)
{
  REPEAT(((int (*)(const double **, double **, long long *, double *, int))f)(arg, res, iw, w, 0));
}

/* void f(const void *model, void *data) */
double time_pair(void *f, const void *model, void *data, long count)
{
  REPEAT(((void (*)(const void *, void *))f)(model, data));
}
