"""An environment with a known region of failures, and a policy for it."""

import gymnasium
import numpy as np
from gymnasium import spaces

ID = "eigenfail/Approach-v0"
MODULE = "approach_functions"
SOURCE = '''
from eigenfail_gymnasium.declared import margin, policy

@policy
def brake(task):
    """Brake for good once less than 3 m are perceived."""
    def act(observation):
        return int(observation[0] < 3.0)
    return act

@policy
def counts(task):
    """Answer by what it remembers: a new episode must begin anew."""
    steps = []
    def act(observation):
        steps.append(1)
        return int(len(steps) > 2)
    return act

@policy
def wrong(task):
    return lambda observation: 7

@policy
def raises(task):
    raise ZeroDivisionError("on purpose")

@margin
def distance(env, info):
    return env.distance_m

def undeclared(task):
    return None
'''


class Approach(gymnasium.Env):
    """Drives 2 m a step towards a wall 10 m away, unless it brakes."""

    observation_space = spaces.Box(-np.inf, np.inf, (2,), np.float32)
    action_space = spaces.Discrete(2)

    def __init__(self, config=None):
        self.config = config

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.distance_m = 10.0
        return self._look(), {"hit": False}

    def step(self, action):
        self.distance_m -= 0.0 if action else 2.0
        hit = self.distance_m <= 0.0
        return self._look(), 0.0, hit, False, {"hit": hit, "calm": False}

    def _look(self):
        return np.array([self.distance_m, self.np_random.normal()], np.float32)
