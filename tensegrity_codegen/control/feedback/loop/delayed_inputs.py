"""Commands that arrive late: the inputs of the model over time."""

import numpy as np

from tensegrity_codegen.control.feedback.design.delays import split_delays
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorBounds
from tensegrity_codegen.system.arrays import FloatArray


class DelayedInputs:
    """The inputs of the model during a sample, where each actuator follows its commands after a delay.

    Parameters
    ----------
    bounds : ActuatorBounds
        Delays of the actuators.
    start : ndarray, shape (n_actuators,) [m]
        Their inputs before the first command arrives.
    sample : float [s]
        Time between two commands.
    """

    def __init__(self, bounds: ActuatorBounds, start: FloatArray, sample: float) -> None:
        self.sample = sample
        self.back, self.offset, _ = split_delays(bounds.delay, sample)
        self.commands = [start] * (int(self.back.max(initial=0)) + 2)

    def push(self, command: FloatArray) -> list[tuple[float, FloatArray]]:
        """Return the inputs from here to the next command.

        Parameters
        ----------
        command : ndarray, shape (n_actuators,) [m]
            The new command.

        Returns
        -------
        list of (float, ndarray)
            Time after the command [s] from which inputs hold, and the inputs (n_actuators,).
        """
        self.commands = [*self.commands[1:], command]
        arrived = [self._arrived(0.0)]
        times = sorted({float(time) for time in self.offset if time > 0.0})
        return list(zip([0.0, *times], [*arrived, *(self._arrived(time) for time in times)], strict=True))

    def _arrived(self, time: float) -> FloatArray:
        """Return the commands that have arrived a time [s] after the last one was given."""
        late = self.back + (self.offset > time)
        rows = np.array(self.commands)[::-1]
        return rows[late, np.arange(len(late))]
