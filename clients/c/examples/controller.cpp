// A controller that uses estimates, for the arm of config/adaptive.toml, in one file to begin your own with. It does what the program `controller` does, but takes
// only values that are usable; the program also takes others if use_ok is 1 and their standard deviation is at most controller.max_std of them. Ctrl-C ends it; the
// optional arguments are the domain and the robot.
//
//     identifier --config config/adaptive.toml & plant_simulator --config config/adaptive.toml --speed 1 & controller_cpp
//
// The arm's equations (26), each multiplied by 12, with q the desired motion and d its damping, which the own loop takes off and which is given back:
//
//     12 u1 = 12 (theta5 + d) q1' + d/dt [(theta3 + 3 theta4 cos^2 q2) q1'] + d2/dt2 [(theta1 + 3 theta2 cos^2 q2) q1']
//     12 u2 = 12 (theta8 + d) q2' + 3/2 theta7 theta9 sin 2q2 q1'^2 + 6 g theta7 cos q2
//           + d/dt [4 theta7 theta9 q2' + theta6 (3/2 theta9 sin 2q2 q1'^2 + 6 g cos q2)] + d2/dt2 [4 theta6 theta9 q2']
#include <array>
#include <cmath>
#include <cstdio>
#include <exception>
#include <thetabus.hpp>

namespace {

constexpr double tau = 6.283185307179586, gravity = 9.81, damping = 31.6957, limit_v = 400.0;
// A command that answers sample k holds from sample k + 1 to k + 2, and is right in the middle.
constexpr double period_s = 1e-3, ahead_s = 1.5 * period_s;
// Time in which a parameter goes over to a new estimate, so that no estimate steps the input.
constexpr double blend_s = 0.2;
// Parameters for 150 kg: what it begins with, and goes on with if nothing may be used.
constexpr std::array<double, 9> begin{0.00434783, 0.0260870, 0.0434783, 0.260870, 23.0, 0.0260870, 0.260870, 23.0, 1.0};

using Pair = std::array<double, 2>;

struct Motion {
    Pair q{}, dq{};
};

// The setpoints of config/adaptive.toml.
Motion desired(double t_s) {
    constexpr double frequency_hz[2][3] = {{0.13, 0.31, 0.71}, {0.17, 0.37, 0.83}};
    constexpr double amplitude_rad[2][3] = {{0.5, 0.3, 0.15}, {0.35, 0.2, 0.12}};
    constexpr double phase_rad[2][3] = {{0.0, 1.0, 2.0}, {0.5, 1.5, 2.5}};
    Motion motion;
    for (int joint = 0; joint < 2; joint++)
        for (int k = 0; k < 3; k++) {
            const double w = tau * frequency_hz[joint][k], at = w * t_s + phase_rad[joint][k];
            motion.q[joint] += amplitude_rad[joint][k] * std::sin(at);
            motion.dq[joint] += amplitude_rad[joint][k] * w * std::cos(at);
        }
    return motion;
}

// The brackets of the equations: what stands there as it is, what is differentiated once, and twice.
std::array<Pair, 3> terms(const std::array<double, 9> &theta, const Motion &m) {
    const double c = std::cos(m.q[1]), centrifugal = 1.5 * theta[8] * std::sin(2.0 * m.q[1]) * m.dq[0] * m.dq[0];
    return {Pair{12.0 * (theta[4] + damping) * m.dq[0],
                 12.0 * (theta[7] + damping) * m.dq[1] + theta[6] * (centrifugal + 6.0 * gravity * c)},
            Pair{(theta[2] + 3.0 * theta[3] * c * c) * m.dq[0],
                 4.0 * theta[6] * theta[8] * m.dq[1] + theta[5] * (centrifugal + 6.0 * gravity * c)},
            Pair{(theta[0] + 3.0 * theta[1] * c * c) * m.dq[0], 4.0 * theta[5] * theta[8] * m.dq[1]}};
}

std::vector<double> feed_forward(const std::array<double, 9> &theta, double t_s) {
    const double h = period_s;
    const auto before = terms(theta, desired(t_s - h)), now = terms(theta, desired(t_s)), after = terms(theta, desired(t_s + h));
    std::vector<double> input(2);
    for (int joint = 0; joint < 2; joint++) {
        const double u = now[0][joint] + (after[1][joint] - before[1][joint]) / (2.0 * h) +
                         (after[2][joint] - 2.0 * now[2][joint] + before[2][joint]) / (h * h);
        input[joint] = std::clamp(u / 12.0, -limit_v, limit_v);
    }
    return input;
}

} // namespace

int main(int count, char **arguments) try {
    const std::string domain = count > 1 ? arguments[1] : "default";
    const std::string robot = count > 2 ? arguments[2] : "arm";
    thetabus::Controller controller(robot, domain);
    thetabus::Estimates estimates(robot, domain);
    thetabus::Samples samples(robot, domain);
    auto theta = begin, target = begin;
    while (auto sample = samples.next()) {
        // Of samples that came together only the newest waits for an answer.
        while (!(sample->flags & THETABUS_END))
            if (const auto newer = samples.next(thetabus::Milliseconds(0)))
                sample = newer;
            else
                break;
        if (sample->flags & THETABUS_END)
            break;
        while (const auto e = estimates.next(thetabus::Milliseconds(0)))
            for (uint32_t i = 0; i < theta.size(); i++)
                if (const auto value = e->get(i); value && value->std <= 0.2 * std::abs(value->value))
                    target[i] = value->value;
        for (size_t i = 0; i < theta.size(); i++)
            theta[i] += (target[i] - theta[i]) * period_s / blend_s;
        const double t_s = 1e-9 * static_cast<double>(sample->t_ns);
        controller.send(*sample, feed_forward(theta, t_s + ahead_s), thetabus::Milliseconds(20));
    }
    return 0;
} catch (const std::exception &e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 1;
}
