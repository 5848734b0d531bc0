"""A controller that uses estimates, for the arm of config/adaptive.toml, to begin your own with. It does what the program `controller` does, but takes only
values that are `usable`; the program also takes others if `use_ok` is 1 and their standard deviation is at most `controller.max_std` of them.

    identifier --config config/adaptive.toml & plant_simulator --config config/adaptive.toml --speed 1 & python controller.py

The optional arguments are the domain and the robot. The arm's equations (26), each multiplied by 12, with q the desired motion and d the damping of the
machine's own loop, which is given back:

    12 u1 = 12 (theta5 + d) q1' + d/dt [(theta3 + 3 theta4 cos^2 q2) q1'] + d2/dt2 [(theta1 + 3 theta2 cos^2 q2) q1']
    12 u2 = 12 (theta8 + d) q2' + 3/2 theta7 theta9 sin 2q2 q1'^2 + 6 g theta7 cos q2
          + d/dt [4 theta7 theta9 q2' + theta6 (3/2 theta9 sin 2q2 q1'^2 + 6 g cos q2)] + d2/dt2 [4 theta6 theta9 q2']
"""

import sys

import numpy as np
import thetabus

GRAVITY, DAMPING, LIMIT_V = 9.81, 31.6957, 400.0
# A command that answers sample k holds from sample k + 1 to k + 2, and is right in the middle.
PERIOD_S = 1e-3
AHEAD_S = 1.5 * PERIOD_S
# Time in which a parameter goes over to a new estimate, so that no estimate steps the input.
BLEND_S = 0.2
# Parameters for 150 kg: what it begins with, and goes on with if nothing may be used.
BEGIN = [0.00434783, 0.0260870, 0.0434783, 0.260870, 23.0, 0.0260870, 0.260870, 23.0, 1.0]

# The setpoints of config/adaptive.toml, joints by sines.
W = 2 * np.pi * np.array([[0.13, 0.31, 0.71], [0.17, 0.37, 0.83]])
AMPLITUDE = np.array([[0.5, 0.3, 0.15], [0.35, 0.2, 0.12]])
PHASE = np.array([[0.0, 1.0, 2.0], [0.5, 1.5, 2.5]])


def terms(theta, t_s):
    """The brackets of the equations: what stands there as it is, what is differentiated once, and twice; by joints and times."""
    at = W[:, :, None] * t_s + PHASE[:, :, None]
    q = (AMPLITUDE[:, :, None] * np.sin(at)).sum(axis=1)
    dq = ((AMPLITUDE * W)[:, :, None] * np.cos(at)).sum(axis=1)
    c = np.cos(q[1])
    centrifugal = 1.5 * theta[8] * np.sin(2 * q[1]) * dq[0] ** 2
    weight = centrifugal + 6 * GRAVITY * c
    plain = [12 * (theta[4] + DAMPING) * dq[0], 12 * (theta[7] + DAMPING) * dq[1] + theta[6] * weight]
    once = [(theta[2] + 3 * theta[3] * c**2) * dq[0], 4 * theta[6] * theta[8] * dq[1] + theta[5] * weight]
    twice = [(theta[0] + 3 * theta[1] * c**2) * dq[0], 4 * theta[5] * theta[8] * dq[1]]
    return np.array(plain), np.array(once), np.array(twice)


def feed_forward(theta, t_s):
    """Voltages at a time, one per joint."""
    h = PERIOD_S
    plain, once, twice = terms(theta, t_s + h * np.array([-1.0, 0.0, 1.0]))
    u = plain[:, 1] + (once[:, 2] - once[:, 0]) / (2 * h) + (twice[:, 2] - 2 * twice[:, 1] + twice[:, 0]) / h**2
    return np.clip(u / 12, -LIMIT_V, LIMIT_V)


def main(domain="default", robot="arm"):
    theta, target = np.array(BEGIN), np.array(BEGIN)
    with (
        thetabus.Controller(robot, domain=domain) as controller,
        thetabus.Estimates(robot, domain=domain) as estimates,
        thetabus.Samples(robot, domain=domain) as samples,
    ):
        for sample in samples:
            # Of samples that came together only the newest waits for an answer.
            while not sample.last and (newer := samples.next(0.0)) is not None:
                sample = newer
            if sample.last:
                break
            while (e := estimates.next(0.0)) is not None:
                taken = e.usable & (e.std <= 0.2 * np.abs(e.values))
                target = np.where(taken, e.values, target)
            theta += (target - theta) * PERIOD_S / BLEND_S
            controller.send(sample, feed_forward(theta, sample.t_s + AHEAD_S), hold_s=0.02)


if __name__ == "__main__":
    main(*sys.argv[1:3])
