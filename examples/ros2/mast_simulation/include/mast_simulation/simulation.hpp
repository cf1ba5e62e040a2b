// The mast as a simulation that advances from tick to tick, as a timer of a node calls it.
#pragma once

#include <memory>
#include <string>
#include <vector>

namespace mast_simulation {

struct Event {
  double time;         // [s]
  std::string member;  // the cable
  bool is_taut;        // goes taut, else slack
};

// Members throw std::runtime_error with the text of the status where the library reports an error; the state
// is then the last one that was reached.
class Simulation {
 public:
  // At rest: the equilibrium with the motor at 0.
  Simulation();
  ~Simulation();

  static std::vector<std::string> member_names();
  static std::vector<std::string> coordinate_names();

  // Value [m] that is added to the rest length of the cable with the motor, from now on.
  void set_motor(double motor);

  // Advance by a duration [s]; events of the tick are appended where a list is given.
  void advance(double duration, std::vector<Event>* events = nullptr);

  double time() const;                      // [s]
  std::vector<double> coordinate() const;   // [m]
  std::vector<double> member_tension() const;  // [N], positive in tension
  double total_energy() const;              // [J]

  // Equilibrium [m] with the present value of the motor, near the present position; the state stays.
  std::vector<double> equilibrium() const;
  std::vector<double> member_tension_at(const std::vector<double>& coordinate) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace mast_simulation
