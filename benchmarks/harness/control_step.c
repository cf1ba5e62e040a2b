/* Times the steps of a controller in C, and its parts; the source of the controller is included, for its parts are
 * static. SOURCE: that file; CONTROL(x): name of the public x; STEP: its step; SAMPLE [s]; WIDTH: numbers that a step
 * takes; WITH_GAINS, WITH_FILTER, WITH_TENSIONS: what it has. Arguments: steps, rows of the file, the file of rows. */
#define _POSIX_C_SOURCE 200809L
#include SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { TURNS = 20000 };

typedef struct {
  long steps, rows;
  double *given, *taken;
} session;

static double now(void)
{
  struct timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int compare(const void *a, const void *b)
{
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

/* Median time of reading the clock. */
static double time_clock(session *s)
{
  long k;
  for (k = 0; k < s->steps; ++k) {
    const double from = now();
    s->taken[k] = now() - from;
  }
  qsort(s->taken, (size_t)s->steps, sizeof(double), compare);
  return s->taken[s->steps / 2];
}

static void time_steps(MEMORY *c, session *s, double empty)
{
  long k, status[16] = {0};
  int most = 0;
  double rest_length[N_U];
  for (k = 0; k < s->steps; ++k) {
    const long row = k % s->rows;
    double from;
    int found;
    if (row == 0) {
      INIT(c, NULL);
    }
    from = now();
    found = STEP(c, (double)row * CONTROL_SAMPLE, s->given + row * WIDTH, rest_length);
    s->taken[k] = now() - from - empty;
    ++status[found];
#if WITH_TENSIONS
    if (c->distribution.iterations > most) {
      most = c->distribution.iterations;
    }
#endif
  }
  qsort(s->taken, (size_t)s->steps, sizeof(double), compare);
  printf("median %.9g\n", s->taken[s->steps / 2]);
  printf("part99 %.9g\n", s->taken[(long)(0.99 * (double)s->steps)]);
  printf("most %.9g\n", s->taken[s->steps - 1]);
  printf("iterations %d\n", most);
  printf("failed %ld\n", s->steps - status[0] - status[1] - status[2] - status[3] - status[4]);
}

#define PART(name, work) \
  do { \
    int turn; \
    const double from = now(); \
    for (turn = 0; turn < TURNS; ++turn) { \
      work; \
    } \
    printf(name " %.9g\n", (now() - from) / TURNS); \
  } while (0)

static double time_parts(MEMORY *c, const session *s)
{
  double input[N_IN], sink = 0.0;
  (void)s;
  INIT(c, NULL);
  PART("motion", (motion_state(0.3, c->work.goal), motion_input(0.3, input), sink += input[0]));
#if WITH_GAINS
  PART("gains", (gains_subtract(0.3, c->deviation, c->wanted), sink += c->wanted[0]));
#endif
#if WITH_FILTER
  PART("predict", (INIT(c, NULL), sink += filter_predict(CONTROL_SAMPLE, c)));
  PART("correct", (INIT(c, NULL), sink += filter_correct(0.3, s->given, c)));
#endif
#if WITH_TENSIONS
  {
    int k;
    INIT(c, NULL);
    motion_state(0.3, c->estimate);
    motion_input(0.3, input);
    for (k = 0; k < N_U; ++k) {
      c->wanted[k] = input[ACTUATOR_PLACE[k]] + (k % 2 == 0 ? 1e-3 : -1e-3);
    }
    actuators_find_bounds(CONTROL_SAMPLE, c);
    PART("distribute", (sink += control_distribute(0.3, c)));
  }
#endif
  PART("init", (INIT(c, NULL), sink += c->command[0]));
  return sink;
}

int main(int argc, char **argv)
{
  static MEMORY c;
  session s;
  FILE *file = argc == 4 ? fopen(argv[3], "rb") : NULL;
  size_t count;
  if (file == NULL) {
    return 1;
  }
  s.steps = atol(argv[1]);
  s.rows = atol(argv[2]);
  count = (size_t)(s.rows * WIDTH);
  s.given = malloc(sizeof(double) * count);
  s.taken = malloc(sizeof(double) * (size_t)s.steps);
  if (s.given == NULL || s.taken == NULL || fread(s.given, sizeof(double), count, file) != count) {
    return 1;
  }
  fclose(file);
  time_steps(&c, &s, time_clock(&s));
  printf("memory %lu\n", (unsigned long)sizeof c);
  return time_parts(&c, &s) == 1e300;
}
