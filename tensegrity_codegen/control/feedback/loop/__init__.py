"""Parts of a closed loop: limits of actuators, disturbances, controller, simulated model, record."""
