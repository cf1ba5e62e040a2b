"""A robot of three rods learns to roll; then its policy in C walks the same way.

    python examples/learn_to_roll.py       needs the extra `learn`

Nine cables with a winch each join the rods, whose round ends touch the ground. It sees how its rods lie
and move, and what it has commanded, 54 numbers, and is paid for its way along x. Friction and stiffnesses are
drawn for each episode. The policy, a network of one layer, is found by evolution strategies: of pairs of
policies on either side of the mean, the mean goes towards the better ones. 100 to 300 generations of
96 robots take one to four minutes on two cores; the numbers depend on the last bits of a machine, for rolling
is chaotic.
"""

import numpy as np

from tensegrity_codegen import Policy, build_controller, compile_scene, environment

HALF, BALL = 0.16, 0.024
ends = {"low": -HALF, "high": HALF}
parts = [
    {
        "kind": "tube",
        "radius": 0.008,
        "inner_radius": 0.006,
        "from": [0, 0, -HALF],
        "to": [0, 0, HALF],
        "mass": 0.06,
    }
]
points = {end: {"position": [0, 0, z], "radius": BALL} for end, z in ends.items()}
for end, z in ends.items():
    parts.append({"kind": "ball", "radius": BALL, "position": [0, 0, z], "mass": 0.02})
    parts.append(
        {"kind": "cylinder", "radius": 0.018, "from": [0, 0, 0.5 * z], "to": [0, 0, 0.9 * z], "mass": 0.07}
    )
    for name, x, y in (("out", 0.02, 0), ("in", -0.02, 0), ("side", 0, 0.02)):
        points[f"{end}_{name}"] = [x, y, 0.94 * z]
robot = {
    "name": "robot",
    "gravity": [0, 0, -9.81],
    "classes": {
        "ring": {"kind": "cable", "damping": 2, "spring_constant": 400, "rest_length": 0.155},
        "side": {"kind": "cable", "damping": 2, "spring_constant": 600, "rest_length": 0.18},
    },
    "ground": {
        "stiffness": 5e3,
        "stick_stiffness": 5e3,
        "stick_damping": 20,
        "dissipation": 0.3,
        "friction": 0.8,
    },
    "bodies": {},
    "members": {},
    "actuators": [],
}
for k in range(3):
    low, high = np.radians(120 * k), np.radians(120 * k + 150)
    robot["bodies"][f"rod{k}"] = {
        "kind": "rigid",
        "from": [0.12 * np.cos(low), 0.12 * np.sin(low), 0.05],
        "to": [0.12 * np.cos(high), 0.12 * np.sin(high), 0.27],
        "parts": parts,
        "points": points,
    }
    for name, kind, start, end in (
        (f"bottom{k}", "ring", f"rod{k}.low_out", f"rod{(k + 1) % 3}.low_in"),
        (f"top{k}", "ring", f"rod{k}.high_out", f"rod{(k + 1) % 3}.high_in"),
        (f"side{k}", "side", f"rod{k}.low_side", f"rod{(k + 2) % 3}.high_side"),
    ):
        robot["members"][name] = {"class": kind, "nodes": [start, end]}
        robot["actuators"].append(
            {"name": f"winch_{name}", "members": name, "rate": 0.5, "range": [0.08, 0.23]}
        )

settings = {
    "observe": ["body_axes", "body_velocity", "body_angular_velocity", "command"],
    "randomise": [
        "ground.friction=uniform(0.5,1)",
        "classes.ring.spring_constant=uniform(360,440)",
        "classes.side.spring_constant=uniform(540,660)",
    ],
    "autoreset": "disabled",
}
robots = environment(robot, 96, stepper={"rtol": 1e-3, "threads": 2}, **settings)
print(robots.stepper.estimate_error().max())  # of a sample at this tolerance [m]

scale = np.repeat([0.6, 0.5, 5.0, 0.05], [27, 9, 9, 9])  # usual sizes of what is seen


def make_policy(numbers):
    """Return the policy of 495 numbers."""
    weights, biases = numbers[:486].reshape(9, 54), numbers[486:]
    description = robots.description
    return Policy(
        weights=(weights,), biases=(biases,), mean=0 * scale, scale=scale, clip=5.0, description=description
    )


def walk(numbers, seed):
    """Return how far along x each robot comes in 10 s, by a policy for each (n, 495)."""
    observation, _ = robots.reset(seed=seed)
    weights, biases, way, alive = numbers[:, :486].reshape(-1, 9, 54), numbers[:, 486:], 0.0, True
    for _ in range(500):
        seen = np.clip(observation / scale, -5.0, 5.0)
        action = np.clip(np.einsum("nas,ns->na", weights, seen) + biases, -1.0, 1.0)
        observation, reward, failed, over, _ = robots.step(action)
        way, alive = way + np.where(alive, reward, 0.0), alive & ~failed
        if failed.any() and not over.any():
            observation, _ = robots.reset(options={"reset_mask": failed})
    return way


def train(goal, most=300, pairs=48, spread=0.15, rate=0.6):
    """Return the mean when its neighbours come `goal` metres far."""
    random, mean, slope = np.random.default_rng(0), np.zeros(495), 0.0
    for generation in range(most):
        noise = random.normal(size=(pairs, 495))
        way = walk(np.concatenate([mean + spread * noise, mean - spread * noise]), generation)
        rank = np.argsort(np.argsort(way)) / (2 * pairs - 1) - 0.5
        slope = 0.8 * slope + 0.2 * (rank[:pairs] - rank[pairs:]) @ noise / pairs
        mean = mean + rate * slope
        if generation % 20 == 19:
            print(f"generation {generation + 1}: {way.mean():.2f} m in the mean")
        if way.mean() > goal:
            break
    return mean


policy = make_policy(train(4.0))
policy.write("policy.npz", overwrite=True)


def follow(policy, seed, n):
    """Return how far along x others come with a policy, at a hundredth of the tolerance."""
    others = environment(robot, n, stepper={"rtol": 1e-5}, **settings)
    observation, _ = others.reset(seed=seed)
    way = np.zeros(n)
    for _ in range(500):
        observation, reward, *_ = others.step(policy(observation))
        way += reward
    return way


way = follow(policy, 12345, 20)
print(f"{way.min():.2f} to {way.max():.2f} m in 10 s")

controller = build_controller(compile_scene(robot), policy=policy, out="policy_c").load()
controller.init()
in_python, in_c = (environment(robot, stepper={"rtol": 1e-5}, observe=settings["observe"]) for _ in range(2))
(first, _), (second, _) = in_python.reset(seed=1), in_c.reset(seed=1)
for _ in range(500):
    first, *_ = in_python.step(policy(first))
    controller.next(second[:45])  # the commands, the last nine numbers, it knows
    second, *_ = in_c.step(controller.read("action"))
print(np.abs(first - second).max())
