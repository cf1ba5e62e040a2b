#include "mast_simulation/simulation.hpp"

#include <algorithm>
#include <array>
#include <iterator>
#include <stdexcept>

#include "mast.h"

namespace mast_simulation {

namespace {

constexpr double rtol = 1e-9, atol = 1e-12;  // of each step; atol in m and m/s
constexpr long long most_steps = 100000;     // of one tick
constexpr int most_events = 100;             // of one tick

void check(const char* function, int status) {
  if (status != MAST_OK) {
    throw std::runtime_error(std::string(function) + ": " + mast_status_text(status) + " (status " +
                             std::to_string(status) + ")");
  }
}

}  // namespace

// A tick allocates nothing: all memory is here.
struct Simulation::State {
  std::array<double, MAST_N_STATES> value{};  // coordinates [m], then velocities [m/s]
  std::array<double, MAST_N_INPUTS> input{};
  std::array<double, MAST_RK853_WORK> work{};
  std::array<mast_event, most_events> event{};
  double time = 0.0, step = 0.0;  // step 0: choose one
  mast_run run{};                 // zero at the start, and where an input jumps
};

Simulation::Simulation() : state_(std::make_unique<State>()) {
  if (mast_descriptor.abi_version != MAST_ABI_VERSION) {
    throw std::runtime_error("the library and its header have different versions of the interface");
  }
  std::copy(std::begin(mast_nominal_coordinate), std::end(mast_nominal_coordinate), state_->value.begin());
  const std::vector<double> rest = equilibrium();
  std::copy(rest.begin(), rest.end(), state_->value.begin());
}

Simulation::~Simulation() = default;

std::vector<std::string> Simulation::member_names() {
  return {std::begin(mast_member_name), std::end(mast_member_name)};
}

std::vector<std::string> Simulation::coordinate_names() {
  return {std::begin(mast_coordinate_name), std::end(mast_coordinate_name)};
}

void Simulation::set_motor(double motor) {
  state_->input[MAST_INPUT_motor] = motor;
  state_->run = mast_run{};  // the accelerations jump: begin again with a small step
  state_->step = 0.0;
}

void Simulation::advance(double duration, std::vector<Event>* events) {
  State& now = *state_;
  const double end = now.time + duration;
  long long n_sampled = 0;
  now.run.watch = MAST_EVENT_CABLE;  // steps end where a cable goes slack or taut
  now.run.event = now.event.data();
  now.run.most_events = most_events;
  now.run.n_events = 0;
  check("mast_integrate_rk853_run",
        mast_integrate_rk853_run(end, rtol, atol, most_steps, &now.time, &now.step, now.value.data(),
                                 now.input.data(), 0, nullptr, nullptr, &n_sampled, &now.run, now.work.data()));
  if (now.time < end) {
    throw std::runtime_error("a tick needs more than " + std::to_string(most_steps) + " steps");
  }
  const long long count = std::min(now.run.n_events, now.run.most_events);
  for (long long k = 0; events != nullptr && k < count; ++k) {
    const mast_event& event = now.event[k];
    events->push_back({event.time, mast_member_name[event.which], event.direction > 0});
  }
}

double Simulation::time() const { return state_->time; }

std::vector<double> Simulation::coordinate() const {
  return {state_->value.begin(), state_->value.begin() + MAST_N_COORDINATES};
}

std::vector<double> Simulation::member_tension() const { return member_tension_at(coordinate()); }

std::vector<double> Simulation::member_tension_at(const std::vector<double>& coordinate) const {
  if (coordinate.size() != MAST_N_COORDINATES) {
    throw std::runtime_error("coordinate must have " + std::to_string(MAST_N_COORDINATES) + " numbers");
  }
  std::vector<double> tension(MAST_N_MEMBERS);
  check("mast_compute_member_tension",
        mast_compute_member_tension(coordinate.data(), state_->input.data(), tension.data()));
  return tension;
}

double Simulation::total_energy() const {
  double energy;
  check("mast_compute_total_energy",
        mast_compute_total_energy(state_->value.data(), state_->value.data() + MAST_N_COORDINATES,
                                  state_->input.data(), &energy));
  return energy;
}

std::vector<double> Simulation::equilibrium() const {
  constexpr double tolerance = 1e-9;  // [N], largest force that remains at a free coordinate
  constexpr int most_iterations = 50;
  std::vector<double> found = coordinate();
  std::array<double, MAST_EQUILIBRIUM_WORK> work;
  mast_equilibrium_report report;
  check("mast_find_equilibrium", mast_find_equilibrium(found.data(), state_->input.data(), tolerance,
                                                       most_iterations, &report, work.data()));
  return found;
}

}  // namespace mast_simulation
