"""Checks the environment of a robot: gym_check.py CONFIG_FOLDER."""
import sys
import warnings

import numpy as np
from gymnasium.utils.env_checker import check_env

from advee_gym import AdveeEnv, AdveeError

env = AdveeEnv(world="empty", people=0, config=sys.argv[1], episode_s=20.0)
with warnings.catch_warnings():
    # A warning of the checker is a finding, but for this: the actions are in m/s and rad.
    warnings.simplefilter("error")
    warnings.filterwarnings("ignore", message=".*recommend using a symmetric and normalized space")
    check_env(env, skip_render_check=True)

# Equal seeds and actions give equal observations; an episode that is over begins anew.
seen = []
for _ in range(2):
    env.action_space.seed(5)
    observations = [env.reset(seed=5)[0]]
    for _ in range(100):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation) and np.isfinite(reward), (observation, reward)
        if terminated or truncated:
            observation, info = env.reset()
        observations.append(observation)
    seen.append(np.array(observations))
assert np.array_equal(*seen), "equal seeds differ"
print("200 steps")

try:
    env.reset(options={"world": "no/world"})
    raise SystemExit("a refused request is no error")
except AdveeError as error:
    assert "world" in str(error), error
env.close()
