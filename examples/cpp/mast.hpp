// The mast as a C++ class: arrays of fixed length instead of pointers, exceptions instead of status numbers.
#pragma once

#include <array>
#include <stdexcept>
#include <string>
#include <vector>

#include "mast.h"

// A function of the library returned a status other than MAST_OK.
class StatusError : public std::runtime_error {
 public:
  StatusError(const std::string& function, int status)
      : std::runtime_error(function + ": " + mast_status_text(status) + " (status " + std::to_string(status) + ")"),
        status_(status) {}

  int status() const noexcept { return status_; }

 private:
  int status_;
};

inline void check(const char* function, int status) {
  if (status != MAST_OK) {
    throw StatusError(function, status);
  }
}

// The functions of the library keep nothing: this class holds the value of the motor alone.
class Mast {
 public:
  using Coordinate = std::array<double, MAST_N_COORDINATES>;  // [m]
  using State = std::array<double, MAST_N_STATES>;            // coordinates [m], then velocities [m/s]
  using Tension = std::array<double, MAST_N_MEMBERS>;         // [N], positive in tension

  struct Motion {
    std::vector<State> sample;      // one at each sample time
    std::vector<mast_event> event;  // cables that go slack or taut
    State end;
  };

  explicit Mast(double motor) { input_[MAST_INPUT_motor] = motor; }

  static Coordinate nominal_coordinate();

  Coordinate find_equilibrium(Coordinate start) const {
    constexpr double tolerance = 1e-9;  // [N], largest force that remains at a free coordinate
    constexpr int most_iterations = 50;
    std::array<double, MAST_EQUILIBRIUM_WORK> work;
    mast_equilibrium_report report;
    check("mast_find_equilibrium", mast_find_equilibrium(start.data(), input_.data(), tolerance, most_iterations,
                                                         &report, work.data()));
    return start;
  }

  Tension member_tension(const Coordinate& coordinate) const {
    Tension tension;
    check("mast_compute_member_tension",
          mast_compute_member_tension(coordinate.data(), input_.data(), tension.data()));
    return tension;
  }

  double total_energy(const State& state) const {
    double energy;
    check("mast_compute_total_energy", mast_compute_total_energy(state.data(), state.data() + MAST_N_COORDINATES,
                                                                 input_.data(), &energy));
    return energy;
  }

  Motion integrate(State state, const std::vector<double>& sample_time) const;

 private:
  std::array<double, MAST_N_INPUTS> input_{};
};
