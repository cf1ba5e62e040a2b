"""Parts of a closed loop: limits of actuators, disturbances, controller, simulated model, record."""

__all__: list[str] = []
