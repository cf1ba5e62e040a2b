// Equilibria and a motion of the mast, and the tensions of a second structure, in one C++ program.
//
// Usage: mast [MOTOR]     MOTOR [m] is added to the rest length of the cable with the motor; default 0.03
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>

#include "mast.hpp"
#include "tower.h"

namespace {

void print_tensions(const char* quantity, const Mast& mast, const Mast::Coordinate& coordinate) {
  const Mast::Tension tension = mast.member_tension(coordinate);
  for (std::size_t k = 0; k < tension.size(); ++k) {
    std::printf("%s %s %.12g N\n", quantity, mast_member_name[k], tension[k]);
  }
}

void print_coordinates(const std::string& quantity, const double* coordinate) {
  for (int k = 0; k < MAST_N_COORDINATES; ++k) {
    std::printf("%s %s %.12g m\n", quantity.c_str(), mast_coordinate_name[k], coordinate[k]);
  }
}

void print_motion(const Mast& mast, const Mast::Coordinate& rest) {
  const std::vector<double> sample_time = {0.05, 0.1, 0.15, 0.2};
  Mast::State start{};  // velocities are zero
  std::copy(rest.begin(), rest.end(), start.begin());

  const Mast::Motion motion = mast.integrate(start, sample_time);
  std::printf("energy start %.12g J\n", mast.total_energy(start));
  for (std::size_t k = 0; k < sample_time.size(); ++k) {
    char label[32];
    std::snprintf(label, sizeof label, "motion_%.2fs", sample_time[k]);
    print_coordinates(label, motion.sample[k].data());
  }
  for (const mast_event& event : motion.event) {
    std::printf("%s %s %.12g s\n", event.direction > 0 ? "taut" : "slack", mast_member_name[event.which],
                event.time);
  }
  std::printf("energy end %.12g J\n", mast.total_energy(motion.end));
}

// Every name of a library begins with the name of its scene: two libraries do not disturb each other.
void print_tower() {
  double tension[TOWER_N_MEMBERS];
  const int status = tower_compute_member_tension(tower_nominal_coordinate, tower_nominal_velocity,
                                                  tower_nominal_input, tower_nominal_rest_length, tension);
  if (status != TOWER_OK) {
    throw std::runtime_error(std::string("tower_compute_member_tension: ") + tower_status_text(status));
  }
  for (int k = 0; k < TOWER_N_MEMBERS; ++k) {
    std::printf("tower_tension %s %.12g N\n", tower_member_name[k], tension[k]);
  }
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
    if (mast_descriptor.abi_version != MAST_ABI_VERSION || tower_descriptor.abi_version != TOWER_ABI_VERSION) {
      throw std::runtime_error("a library and its header have different versions of the interface");
    }
    const Mast at_rest(0.0), moved(motor);
    const Mast::Coordinate rest = at_rest.find_equilibrium(Mast::nominal_coordinate());
    print_tensions("tension_at_rest", at_rest, rest);
    const Mast::Coordinate equilibrium = moved.find_equilibrium(rest);
    print_tensions("tension_moved", moved, equilibrium);
    print_coordinates("position_moved", equilibrium.data());
    print_motion(moved, rest);
    print_tower();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
  }
  return 0;
}
