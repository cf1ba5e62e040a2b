"""A Rosenbrock method: implicit steps by linear systems with the Jacobian, without an iteration."""

from tensegrity_codegen.tables.integrators.integrator import Integrator

INTEGRATOR = Integrator(
    name="rodas",
    kind="adaptive",
    title="Rosenbrock method RODAS5P (Steinebach 2023) with eight stages and the Jacobian, for much damping "
    "in soft members",
    order=5,
    quantities=("state_jacobian",),
    rates=10,
    dense_order=4,
    noise_share=1.0,
    vibration_loss=(1.9e-5, 6),
    look=(1, "dotted", "*"),
    in_single=False,
)
