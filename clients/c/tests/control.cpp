// Commands to an identifier as a C++ program sees them; beside a running identifier of the paper's arm.
#include <cstdio>
#include <string>
#include <thetabus.hpp>

namespace {

void check(bool holds, const char *what) {
    if (!holds)
        throw std::runtime_error(what);
}

template <class Act> void refused(Act act, const std::string &word) {
    try {
        act();
    } catch (const thetabus::Error &e) {
        check(e.code == THETABUS_REFUSED, "the code of a refusal");
        check(std::string(e.what()).find(word) != std::string::npos, e.what());
        return;
    }
    throw std::runtime_error("expected a refusal because of " + word);
}

} // namespace

int main(int, char **arguments) try {
    thetabus::Control control("arm", arguments[1]);
    const auto described = control.ask(THETABUS_DESCRIBE);
    check(described->items_len > 9 && std::string(described->items[0].name) == "theta_1", "the first parameter's name");
    control.fix("theta_9", 1.0);
    control.free("theta_9");
    control.set("forgetting_factor", 0.99);
    refused([&] { control.set("forgetting_factor", 7.0); }, "forgetting_factor");
    refused([&] { control.fix("theta_99"); }, "theta_99");
    refused([&] { control.payload(2.0, {0.0, 0.0, 0.1}); }, "this model has none");
    control.pause();
    control.resume();
    control.reset();
    // moved, a handle still closes once
    thetabus::Control moved = std::move(control);
    moved.ask(THETABUS_DESCRIBE);
    return 0;
} catch (const std::exception &e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 1;
}
