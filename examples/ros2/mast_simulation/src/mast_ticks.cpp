// Ticks of 50 ms, as a timer of a node would make them, printed.
//
// Usage: mast_ticks [MOTOR]     MOTOR [m] is added to the rest length of the cable with the motor; default 0.03
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <vector>

#include "mast_simulation/simulation.hpp"

namespace {

using mast_simulation::Event;
using mast_simulation::Simulation;

void print_rows(const std::string& quantity, const std::vector<std::string>& names,
                const std::vector<double>& values, const char* unit) {
  for (std::size_t k = 0; k < names.size(); ++k) {
    std::printf("%s %s %.12g %s\n", quantity.c_str(), names[k].c_str(), values[k], unit);
  }
}

void run(double motor) {
  Simulation simulation;
  std::vector<Event> events;

  print_rows("tension_at_rest", simulation.member_names(), simulation.member_tension(), "N");
  simulation.set_motor(motor);
  const std::vector<double> moved = simulation.equilibrium();
  print_rows("tension_moved", simulation.member_names(), simulation.member_tension_at(moved), "N");
  print_rows("position_moved", simulation.coordinate_names(), moved, "m");

  std::printf("energy start %.12g J\n", simulation.total_energy());
  for (int tick = 0; tick < 4; ++tick) {
    char label[32];
    simulation.advance(0.05, &events);
    std::snprintf(label, sizeof label, "motion_%.2fs", simulation.time());
    print_rows(label, simulation.coordinate_names(), simulation.coordinate(), "m");
  }
  for (const Event& event : events) {
    std::printf("%s %s %.12g s\n", event.is_taut ? "taut" : "slack", event.member.c_str(), event.time);
  }
  std::printf("energy end %.12g J\n", simulation.total_energy());
}

}  // namespace

int main(int argc, char** argv) {
  double motor = 0.03;
  if (argc > 1) {
    char* end = nullptr;
    motor = std::strtod(argv[1], &end);
    if (argc > 2 || end == argv[1] || *end != '\0') {
      std::fprintf(stderr, "usage: %s [MOTOR]: MOTOR is a length in metres, such as 0.03\n", argv[0]);
      return 2;
    }
  }
  try {
    run(motor);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
  }
  return 0;
}
