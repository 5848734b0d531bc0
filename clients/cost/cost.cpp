// Processor time per message in C++: `cost publish|read COUNT DOMAIN` prints nanoseconds. See cost.py.
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <thetabus.hpp>

// Time that this thread has run in ns, proc_pid_schedstat.
static double used_ns() {
    double used = 0.0;
    std::ifstream("/proc/self/schedstat") >> used;
    return used;
}

int main(int, char **arguments) try {
    const long messages = std::atol(arguments[2]);
    double begun = 0.0, used = 0.0, sum = 0.0;
    if (std::string(arguments[1]) == "publish") {
        thetabus::Machine machine(2, "arm", arguments[3], 1, std::chrono::seconds(20));
        begun = used_ns();
        for (long k = 0; k < messages; k++) {
            thetabus_sample_t sample{};
            sample.signals = THETABUS_Q | THETABUS_INPUT;
            sample.t_ns = static_cast<uint64_t>(k) * 1000000u;
            sample.q[0] = sample.q[1] = 1e-3 * static_cast<double>(k);
            machine.publish(sample);
        }
        used = used_ns() - begun;
    } else {
        thetabus::Samples samples("arm", arguments[3]);
        samples.next();
        begun = used_ns();
        for (long k = 1; k < messages; k++)
            sum += samples.next()->q[0];
        used = used_ns() - begun;
        if (!(sum > 0.0))
            return 1;
    }
    std::printf("%g\n", used / static_cast<double>(messages));
    return 0;
} catch (const std::exception &e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 1;
}
