"""Computes robots' dynamics with the PyPI package pin (pinocchio) and prints how far the given numbers are from them.

The first argument is a directory with robots 0.urdf, 1.urdf, … and states 0.csv, 1.csv, …: each line has q, dq, ddq, the torque, the momentum,
dT/dq and the gravity torque of the joints in the order of names.csv. The output is the largest difference of each of the four, relative to the
largest number of its kind, or torque, in the line.
"""

import csv
import pathlib
import sys

import numpy as np
import pinocchio as pin

worst = np.zeros(4)
lines = 0
for urdf in sorted(pathlib.Path(sys.argv[1]).glob("*.urdf")):
    model = pin.buildModelFromUrdf(str(urdf))
    data = model.createData()
    names = urdf.with_suffix(".names").read_text().split()
    assert sorted(names) == sorted(model.names[1:]), (names, list(model.names))
    joints = [model.joints[model.getJointId(name)] for name in names]
    n = len(joints)
    for line in csv.reader(urdf.with_suffix(".csv").open()):
        values = np.array([float(field) for field in line]).reshape(7, n)
        q = pin.neutral(model)
        dq, ddq = np.zeros(model.nv), np.zeros(model.nv)
        for k, joint in enumerate(joints):
            # A continuous joint has cos q and sin q.
            if joint.nq == 2:
                q[joint.idx_q : joint.idx_q + 2] = np.cos(values[0, k]), np.sin(values[0, k])
            else:
                q[joint.idx_q] = values[0, k]
            dq[joint.idx_v], ddq[joint.idx_v] = values[1, k], values[2, k]
        order = [joint.idx_v for joint in joints]
        torque = pin.rnea(model, data, q, dq, ddq).copy()
        mass = pin.crba(model, data, q).copy()
        mass = np.triu(mass) + np.triu(mass, 1).T
        coriolis = pin.computeCoriolisMatrix(model, data, q, dq).copy()
        gravity = pin.computeGeneralizedGravity(model, data, q).copy()
        expected = [torque, mass @ dq, coriolis.T @ dq, gravity]
        for i, vector in enumerate(expected):
            vector = vector[order]
            difference = np.abs(vector - values[3 + i]).max()
            # dT/dq of a single joint is 0: beside torques of no size its rounding is none either.
            size = max(np.abs(vector).max(), np.abs(torque).max())
            worst[i] = max(worst[i], difference / size)
        lines += 1
print(lines, *worst)
