#include "mast.hpp"

#include <algorithm>
#include <iterator>

Mast::Coordinate Mast::nominal_coordinate() {
  Coordinate coordinate;
  std::copy(std::begin(mast_nominal_coordinate), std::end(mast_nominal_coordinate), coordinate.begin());
  return coordinate;
}

// Integrate from time 0 to the last sample time; the motor has its value from the first moment on.
Mast::Motion Mast::integrate(State state, const std::vector<double>& sample_time) const {
  constexpr double rtol = 1e-9, atol = 1e-12;  // of each step; atol in m and m/s
  constexpr long long most_steps = 100000;
  const auto n_samples = static_cast<long long>(sample_time.size());
  std::vector<double> work(MAST_RK853_WORK);
  Motion motion;
  double time = 0.0, step = 0.0;  // step 0: choose one
  long long n_sampled = 0;
  mast_run run{};  // zero, also fields that a later version adds

  motion.sample.resize(sample_time.size());
  motion.event.resize(100);
  run.watch = MAST_EVENT_CABLE;  // steps end where a cable goes slack or taut
  run.event = motion.event.data();
  run.most_events = static_cast<long long>(motion.event.size());
  check("mast_integrate_rk853_run",
        mast_integrate_rk853_run(sample_time.back(), rtol, atol, most_steps, &time, &step, state.data(),
                                 input_.data(), n_samples, sample_time.data(), motion.sample.front().data(),
                                 &n_sampled, &run, work.data()));
  if (n_sampled < n_samples) {
    throw std::runtime_error("the motion ended early, after " + std::to_string(most_steps) + " steps");
  }
  motion.event.resize(static_cast<std::size_t>(std::min(run.n_events, run.most_events)));
  motion.end = state;
  return motion;
}
