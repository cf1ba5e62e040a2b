"""A robot learns to roll; then its policy in C walks the same way.

    python examples/learn_to_roll.py SCENE.toml [START]       needs the extra `learn`

The scene is a robot of rigid bodies on the ground with actuators; by default three rods of the gallery. START
is "scene" for a robot that does not come to rest by itself, or another start of `environment`. The robot
sees how its bodies lie and move, and what it has commanded, and is paid for its way along x. Friction is
drawn for each episode. The policy, a network of one layer, is found by evolution strategies: of pairs of
policies on either side of the mean, the mean goes towards the better ones. 100 to 300 generations of 96
copies of three rods take one to four minutes on two cores; the numbers depend on the last bits of a machine,
for rolling is chaotic. Writes policy.npz and, as a controller in C, policy_c.
"""

import sys
from pathlib import Path

import numpy as np

from tensegrity_codegen import Policy, build_controller, compile_scene, environment

GALLERY = Path(__file__).parents[1] / "docs" / "gallery"
scene = sys.argv[1] if len(sys.argv) > 1 else str(GALLERY / "three_rods.toml")
observe = ["body_axes", "body_velocity", "body_angular_velocity", "command"]
start = {"start": sys.argv[2]} if len(sys.argv) > 2 else {}
episodes = {"randomise": ["ground.friction=uniform(0.5,1)"], "autoreset": "disabled"}
settings = {"observe": observe, **start, **episodes}
robots = environment(scene, 96, stepper={"rtol": 1e-3, "threads": 2}, **settings)
n_seen, n_moved = robots.single_observation_space.shape[0], robots.single_action_space.shape[0]
n_bodies = (n_seen - n_moved) // 15
usual = [0.6] * 9 * n_bodies + [0.5] * 3 * n_bodies + [5.0] * 3 * n_bodies + [0.05] * n_moved
scale = np.array(usual)  # sizes of what is seen: entries of axes, m/s, rad/s, m


def walk(numbers, seed):
    """Return how far along x each robot comes in 10 s, by a policy for each, (n, n_moved (n_seen + 1))."""
    observation, _ = robots.reset(seed=seed)
    weights, biases = numbers[:, :-n_moved].reshape(-1, n_moved, n_seen), numbers[:, -n_moved:]
    way, alive = np.zeros(len(numbers)), True
    for _ in range(500):
        seen = np.clip(observation / scale, -5.0, 5.0)
        action = np.clip(np.einsum("nas,ns->na", weights, seen) + biases, -1.0, 1.0)
        observation, reward, failed, over, _ = robots.step(action)
        way, alive = way + np.where(alive, reward, 0.0), alive & ~failed
        if failed.any() and not over.any():
            observation, _ = robots.reset(options={"reset_mask": failed})
    return way


def train(goal, most=300, pairs=48, spread=0.15, rate=0.6):
    """Return the mean when its neighbours come `goal` metres far, or Ctrl-C ends the training."""
    random, mean, slope = np.random.default_rng(0), np.zeros(n_moved * (n_seen + 1)), 0.0
    try:
        for generation in range(most):
            noise = random.normal(size=(pairs, mean.size))
            way = walk(np.concatenate([mean + spread * noise, mean - spread * noise]), generation)
            rank = np.argsort(np.argsort(way)) / (2 * pairs - 1) - 0.5
            slope = 0.8 * slope + 0.2 * (rank[:pairs] - rank[pairs:]) @ noise / pairs
            mean = mean + rate * slope
            if generation % 5 == 4:
                print(f"generation {generation + 1}: {way.mean():.2f} m in the mean", flush=True)
            if way.mean() > goal:
                break
    except KeyboardInterrupt:
        print("training ends here, with the policy so far", flush=True)
    return mean


def follow(seed, n):
    """Return how far along x others come with the policy, at a hundredth of the tolerance."""
    others = environment(scene, n, stepper={"rtol": 1e-5}, **settings)
    observation, _ = others.reset(seed=seed)
    way = np.zeros(n)
    for _ in range(500):
        observation, reward, *_ = others.step(policy(observation))
        way += reward
    return way


best = train(4.0)
policy = Policy(
    weights=(best[:-n_moved].reshape(n_moved, n_seen),),
    biases=(best[-n_moved:],),
    mean=0.0 * scale,
    scale=scale,
    clip=5.0,
    description=robots.description,
)
policy.write("policy.npz", overwrite=True)
way = follow(12345, 20)
print(f"{way.min():.2f} to {way.max():.2f} m in 10 s")

controller = build_controller(compile_scene(scene), policy=policy, out="policy_c", overwrite=True).load()
controller.init()
in_python, in_c = (environment(scene, stepper={"rtol": 1e-5}, observe=observe, **start) for _ in range(2))
(first, _), (second, _) = in_python.reset(seed=1), in_c.reset(seed=1)
for _ in range(500):
    first, *_ = in_python.step(policy(first))
    controller.next(second[:-n_moved])  # the commands, the last numbers, it knows
    second, *_ = in_c.step(controller.read("action"))
print(f"largest difference of the walk with the policy in C: {np.abs(first - second).max():.0e}")
