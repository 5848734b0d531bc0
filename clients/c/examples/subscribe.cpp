// Prints what may be used of each estimate. Ctrl-C ends it; the optional arguments are the domain, the robot, and after how many estimates it ends.
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <thetabus.hpp>

int main(int count, char **arguments) try {
    const std::string domain = count > 1 ? arguments[1] : "default";
    const std::string robot = count > 2 ? arguments[2] : "arm";
    long left = count > 3 ? std::atol(arguments[3]) : -1;
    thetabus::Descriptions descriptions(robot, domain);
    thetabus::Estimates estimates(robot, domain);
    auto names = std::make_unique<thetabus::Description>();
    while (left != 0) {
        const auto e = estimates.next();
        // The identifier sends its names before its first estimate, and again when it starts anew.
        while (auto found = descriptions.next(std::chrono::milliseconds(names->model_hash == e->model_hash ? 0 : 1000)))
            *names = *found;
        std::printf("block %llu at %.3f s:", static_cast<unsigned long long>(e->block), 1e-9 * static_cast<double>(e->t_last_ns));
        for (uint32_t i = 0; i < e->params; i++)
            if (const auto parameter = e->get(i); parameter && names->model_hash == e->model_hash)
                std::printf("  %s = %.17g +- %.2g %s", names->name(i).c_str(), parameter->value, parameter->std, names->unit(i).c_str());
        std::printf("\n");
        std::fflush(stdout);
        left -= left > 0;
    }
    return 0;
} catch (const std::exception &e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 1;
}
