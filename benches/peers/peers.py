"""Estimators in Python on the data that thetabus-peers writes: `peers.py FOLDER [NAME ...]`.

Prints a line per estimator: job, estimator, samples, ns a sample, worst and median relative error of theta.
The job "rows" is recursive least squares on given rows; "log" is theta from positions and voltages;
"robot" is a six-axis robot from its log, and the errors are the residuals of the torques on another
motion, by joint.
"""

import pathlib
import sys
import time

import numpy as np

PERIOD_S = 1e-3
GRAVITY = 9.81
LSB_RAD = 2 * np.pi / 65536
POSITION_STD = LSB_RAD / np.sqrt(12)
VOLTAGE_STD = 0.05
# the start values of config/encoder_only.toml
FAR = np.array([0.010869565, 0.0104348, 0.01739132, 0.652175, 9.2, 0.0652175, 0.104348, 57.5, 0.4])
# variance of each parameter at the start of a recursion on given rows
START_VARIANCE = 10.0
# the parameters that the motion tells to 1 %: theta_2, theta_5, theta_7, theta_8, theta_9
TOLD = [1, 4, 6, 7, 8]


def theta_of(one, two):
    """theta_1 ... theta_5 and theta_6, theta_7, theta_8, theta_6 theta_9, theta_7 theta_9 as theta."""
    return np.array([*one, two[0], two[1], two[2], two[4] / two[1]])


class Data:
    def __init__(self, folder):
        rows = np.loadtxt(folder / "rows.csv", delimiter=",", skiprows=1)
        self.a, self.y, self.b, self.z = rows[:, :5], rows[:, 5], rows[:, 6:11], rows[:, 11]
        log = np.loadtxt(folder / "log.csv", delimiter=",", skiprows=1)
        self.q, self.voltage = log[:, :2], log[:, 2:]
        self.truth = np.loadtxt(folder / "truth.csv", skiprows=1)
        self.folder = folder

    def errors(self, theta):
        return np.abs(theta / self.truth - 1)[TOLD]

    def near(self):
        """Start values that are 10 % off, up and down in turn."""
        return self.truth * (1 + 0.1 * (-1.0) ** np.arange(9))


# --- job "rows" -----------------------------------------------------------------------------------------------------


def numpy_rls(data):
    thetas = []
    for phis, ys in ((data.a, data.y), (data.b, data.z)):
        theta, p = np.zeros(5), START_VARIANCE * np.eye(5)
        for phi, y in zip(phis, ys):
            p_phi = p @ phi
            gain = p_phi / (1.0 + phi @ p_phi)
            theta = theta + gain * (y - phi @ theta)
            p = p - np.outer(gain, p_phi)
        thetas.append(theta)
    return theta_of(*thetas), len(data.y)


def padasip_rls(data):
    import padasip

    thetas = []
    for phis, ys in ((data.a, data.y), (data.b, data.z)):
        # its eps is the inverse of the variance at the start
        rls = padasip.filters.FilterRLS(n=5, mu=1.0, eps=1 / START_VARIANCE, w="zeros")
        for phi, y in zip(phis, ys):
            rls.adapt(y, phi)
        thetas.append(rls.w)
    return theta_of(*thetas), len(data.y)


# --- job "log" ------------------------------------------------------------------------------------------------------
# The arm as six states x = (q1, p1, a1, q2, p2, a2), see src/studies/states/arm.rs of thetabus.


def rate(x, th, u, lib=np):
    """dx/dt; the columns of x and th may be many points at once."""
    c, s = lib.cos(x[3]), lib.sin(x[3])
    d1 = x[1] / (th[0] + 3 * th[1] * c * c)
    d2 = x[4] / (4 * th[5] * th[8])
    centrifugal = 3.0 * s * c * d1 * d1
    weight = 6 * GRAVITY * c
    return [
        d1,
        x[2] - (th[2] + 3 * th[3] * c * c) * d1,
        12 * (u[0] - th[4] * d1),
        d2,
        x[5] - 4 * th[6] * th[8] * d2 - th[5] * (th[8] * centrifugal + weight),
        12 * (u[1] - th[7] * d2) - th[6] * (th[8] * centrifugal + weight),
    ]


def advance(x, th, u, steps=2):
    h = PERIOD_S / steps
    for _ in range(steps):
        k1 = np.array(rate(x, th, u))
        k2 = np.array(rate(x + h / 2 * k1, th, u))
        k3 = np.array(rate(x + h / 2 * k2, th, u))
        k4 = np.array(rate(x + h * k3, th, u))
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def augmented(state, u):
    """(x, ln theta) one period on, for one point or a column each."""
    return np.concatenate([advance(state[:6], np.exp(state[6:]), u), state[6:]])


def augmented_start(data, theta, theta_std):
    state = np.concatenate([[data.q[0, 0], 0, 0, data.q[0, 1], 0, 0], np.log(theta)])
    std = np.concatenate([[1e-3, 1, 10, 1e-3, 1, 10], theta_std * np.ones(9)])
    return state, np.diag(std**2)


def input_noise(state, u):
    step = 0.1
    columns = []
    for joint in range(2):
        shifted = np.array(u)
        shifted[joint] += step
        columns.append((augmented(state, shifted) - augmented(state, u)) / step)
    g = np.array(columns).T
    return VOLTAGE_STD**2 * g @ g.T


def filterpy_ekf(data, *start):
    from filterpy.kalman import ExtendedKalmanFilter

    ekf = ExtendedKalmanFilter(dim_x=15, dim_z=2)
    ekf.x, ekf.P = augmented_start(data, *start)
    ekf.R = POSITION_STD**2 * np.eye(2)
    h = np.zeros((2, 15))
    h[0, 0] = h[1, 3] = 1
    step = 1e-6
    for q, u in zip(data.q, data.voltage):
        ekf.update(q, lambda _: h, lambda x: h @ x)
        points = ekf.x[:, None] + np.concatenate([step * np.eye(15), -step * np.eye(15)], axis=1)
        moved = augmented(points, u)
        ekf.F = (moved[:, :15] - moved[:, 15:]) / (2 * step)
        noise = input_noise(ekf.x, u)
        ekf.x = augmented(ekf.x, u)
        ekf.P = ekf.F @ ekf.P @ ekf.F.T + noise
    return np.exp(ekf.x[6:]), len(data.q)


def filterpy_ukf(data, *start, count=7600):
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    points = MerweScaledSigmaPoints(15, alpha=0.1, beta=2.0, kappa=0.0)
    h = lambda x: x[[0, 3]]
    ukf = UnscentedKalmanFilter(15, 2, PERIOD_S, h, lambda x, dt, u: augmented(x, u), points)
    ukf.x, ukf.P = augmented_start(data, *start)
    ukf.R = POSITION_STD**2 * np.eye(2)
    for q, u in zip(data.q[:count], data.voltage[:count]):
        ukf.update(q)
        # Rounding may take the covariance's last digits; a square root of it is needed.
        ukf.P = (ukf.P + ukf.P.T) / 2 + 1e-14 * np.eye(15)
        ukf.Q = input_noise(ukf.x, u) + 1e-16 * np.eye(15)
        ukf.predict(u=u)
    return np.exp(ukf.x[6:]), count


def casadi_gauss_newton(data):
    """Output error by single shooting: positions simulated with the recorded voltages, at rest in the beginning."""
    import casadi as ca

    x, th, u = ca.SX.sym("x", 6), ca.SX.sym("th", 9), ca.SX.sym("u", 2)
    f = lambda x: ca.vertcat(*rate([x[i] for i in range(6)], [th[i] for i in range(9)], [u[0], u[1]], ca))
    h, end = PERIOD_S / 2, x
    for _ in range(2):
        k1 = f(end)
        k2 = f(end + h / 2 * k1)
        k3 = f(end + h / 2 * k2)
        k4 = f(end + h * k3)
        end = end + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    step = ca.Function("step", [x, th, u], [end])
    count = len(data.q)
    shots = step.mapaccum("shots", count - 1)
    eta = ca.MX.sym("eta", 9)
    theta = ca.exp(eta)
    start = ca.vertcat(data.q[0, 0], 0, 0, data.q[0, 1], 0, 6 * GRAVITY * theta[5] * float(np.cos(data.q[0, 1])))
    states = shots(start, ca.repmat(theta, 1, count - 1), data.voltage[:-1].T)
    error = ca.vec(states[[0, 3], :] - data.q[1:].T)
    # one column of the Jacobian per parameter, forwards
    seeds = ca.MX.eye(9)
    columns = [ca.jtimes(error, eta, seeds[:, i]) for i in range(9)]
    both = ca.Function("both", [eta], [error, ca.horzcat(*columns)])
    at = np.log(FAR)
    damping, last = 1e-3, None
    for _ in range(60):
        e, j = (np.array(m) for m in both(at))
        loss = float((e**2).sum())
        if last is not None and not loss < last[0]:
            damping *= 10
            if damping > 1e8:
                break
        else:
            done = last is not None and last[0] - loss < 1e-9 * loss
            last, damping = (loss, at, e, j), max(damping / 10, 1e-12)
            if done:
                break
        _, at, e, j = last
        normal = j.T @ j
        at = at - np.clip(np.linalg.solve(normal + damping * np.diag(np.diag(normal)), j.T @ e)[:, 0], -1, 1)
    return np.exp(last[1]), count


def scipy_least_squares(data):
    """The equations as they are, on positions that a Savitzky-Golay filter differentiates."""
    from scipy.optimize import least_squares
    from scipy.signal import savgol_filter

    window, degree = 61, 5
    d = [savgol_filter(data.q, window, degree, deriv=k, delta=PERIOD_S, axis=0)[100:-100] for k in range(4)]
    (_, q2), (v1, v2), (a1, a2), (j1, j2) = (x.T for x in d)
    # a voltage that is held jumps at the samples
    held = (data.voltage[1:] + data.voltage[:-1]) / 2
    u = 12 * savgol_filter(np.vstack([data.voltage[:1], held]), window, degree, axis=0)[100:-100]
    c, s = np.cos(q2), np.sin(q2)
    s2, c2, cc = 2 * s * c, c * c - s * s, c * c
    jerk = 3 * cc * j1 - 6 * c2 * v1 * v2 * v2 - 6 * s2 * v2 * a1 - 3 * s2 * v1 * a2
    one = np.array([j1, jerk, a1, 3 * cc * a1 - 3 * s2 * v1 * v2, 12 * v1]).T
    b6, b7, b8 = -6 * GRAVITY * s * v2, 6 * GRAVITY * c, 12 * v2
    a6, a7 = 4 * j2 + 3 * c2 * v1 * v1 * v2 + 3 * s2 * v1 * a1, 4 * a2 + 1.5 * s2 * v1 * v1

    def residual(th):
        two = th[5] * (b6 + th[8] * a6) + th[6] * (b7 + th[8] * a7) + th[7] * b8
        return np.concatenate([one @ th[:5] - u[:, 0], two - u[:, 1]])

    return least_squares(residual, FAR, x_scale=FAR, method="lm").x, len(data.q)


# --- job "robot" ----------------------------------------------------------------------------------------------------


def pinocchio_least_squares(data):
    """Inertial parameters of all bodies, rotors and friction: least squares on the torque regressor,
    both sides through a low-pass of 10 Hz forth and back and every tenth sample kept; the joints
    weighted by their residuals in a second pass."""
    import pinocchio as pin
    from scipy.signal import butter, filtfilt

    model = pin.buildModelFromUrdf(str(data.folder / "robot.urdf"))
    workspace, n = model.createData(), model.nq
    train = np.loadtxt(data.folder / "robot_train.csv", delimiter=",", skiprows=1)
    judge = np.loadtxt(data.folder / "robot_judge.csv", delimiter=",", skiprows=1)
    start = time.process_time()

    def rows(q, dq, ddq):
        phi = np.zeros((len(q), n, 14 * n))
        for k in range(len(q)):
            phi[k, :, : 10 * n] = pin.computeJointTorqueRegressor(model, workspace, q[k], dq[k], ddq[k])
        for joint in range(n):
            own = np.array([dq[:, joint], np.tanh(dq[:, joint] / 1e-2), np.ones(len(q)), ddq[:, joint]]).T
            phi[:, joint, 10 * n + 4 * joint : 10 * n + 4 * joint + 4] = own
        return phi

    b, a = butter(2, 40.0, fs=1 / PERIOD_S)
    q, dq = filtfilt(b, a, train[:, :n], axis=0), filtfilt(b, a, train[:, n : 2 * n], axis=0)
    phi, tau = rows(q, dq, np.gradient(dq, PERIOD_S, axis=0)), train[:, 2 * n :]
    b, a = butter(2, 10.0, fs=1 / PERIOD_S)
    phi, tau = (filtfilt(b, a, x, axis=0)[500:-500:10] for x in (phi, tau))
    weights = np.ones(n)
    for _ in range(2):
        w = np.tile(weights, len(phi))
        beta = np.linalg.lstsq(phi.reshape(-1, 14 * n) * w[:, None], tau.reshape(-1) * w, rcond=1e-9)[0]
        weights = 1 / np.std(tau - phi @ beta, axis=0)
    seconds = time.process_time() - start
    q, dq, ddq, measured = (judge[:, i * n : (i + 1) * n] for i in range(4))
    predicted = rows(q, dq, ddq) @ beta
    residual = np.sqrt(np.sum((measured - predicted) ** 2, axis=0) / np.sum(measured**2, axis=0))
    return residual, len(train), seconds


PROGRAMS = [
    ("rows", "numpy RLS", numpy_rls),
    ("rows", "padasip FilterRLS", padasip_rls),
    ("log", "filterpy EKF", lambda data: filterpy_ekf(data, FAR, 1.0)),
    ("log", "filterpy EKF, from 10 % off", lambda data: filterpy_ekf(data, data.near(), 0.1)),
    ("log", "filterpy UKF (first 7.6 s)", lambda data: filterpy_ukf(data, FAR, 1.0)),
    ("log", "filterpy UKF, from 10 % off (first 7.6 s)", lambda data: filterpy_ukf(data, data.near(), 0.1)),
    ("log", "scipy least_squares (off line)", scipy_least_squares),
    ("log", "CasADi Gauss-Newton (off line)", casadi_gauss_newton),
    ("robot", "pinocchio regressor, least squares (off line)", pinocchio_least_squares),
]


def main():
    data = Data(pathlib.Path(sys.argv[1]))
    wanted = sys.argv[2:]
    for job, name, program in PROGRAMS:
        if wanted and not any(word in name for word in wanted):
            continue
        start = time.process_time()
        try:
            with np.errstate(all="ignore"):
                result, count, *seconds = program(data)
            errors = np.sort(result if job == "robot" else data.errors(result))
        except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
            print(f"{name}: {error}", file=sys.stderr)
            errors, count, seconds = np.full(len(TOLD), np.nan), len(data.q), [np.nan]
        each = (seconds[0] if seconds else time.process_time() - start) / count * 1e9
        print(f'{job},"{name}",{count},{each:.4g},{errors[-1]:.4e},{errors[len(errors) // 2]:.4e}', flush=True)


if __name__ == "__main__":
    main()
