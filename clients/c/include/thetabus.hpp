// thetabus for C++17: the functions of thetabus.h as objects that close themselves and throw.
//
//   thetabus::Estimates estimates;                      // domain "default", robot "arm"
//   while (auto e = estimates.next())                   // waits for ever, or as long as stated
//       if (auto mass = e->get(6)) use(mass->value, mass->std);
//
// An object belongs to one thread at a time. Units are SI and radians.
#ifndef THETABUS_HPP
#define THETABUS_HPP

#include "thetabus.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace thetabus {

/// What went wrong, in words; `code` is one of THETABUS_ERROR, THETABUS_INVALID, THETABUS_REFUSED.
class Error : public std::runtime_error {
public:
    explicit Error(int32_t code) : std::runtime_error(thetabus_last_error()), code(code) {}
    int32_t code;
};

using Milliseconds = std::chrono::milliseconds;
/// No limit.
inline constexpr Milliseconds forever{-1};

namespace detail {

inline void check(int32_t code) {
    if (code != THETABUS_OK)
        throw Error(code);
}

template <size_t N> std::string text(const char (&field)[N]) {
    return std::string(field, strnlen(field, N));
}

inline int32_t limit(Milliseconds timeout) {
    return timeout.count() < 0 ? -1 : static_cast<int32_t>(std::min<int64_t>(timeout.count(), INT32_MAX));
}

template <class Handle, class Message, auto Open, auto Next, auto Close> class Reader {
public:
    explicit Reader(const std::string &robot = "arm", const std::string &domain = "default") {
        Handle *handle = nullptr;
        check(Open(domain.c_str(), robot.c_str(), &handle));
        handle_.reset(handle);
    }

    /// The next message, or nothing if none comes within `timeout`.
    std::optional<Message> next(Milliseconds timeout = forever) {
        std::optional<Message> message{std::in_place};
        const int32_t code = Next(handle_.get(), &*message, &sent_ns_, limit(timeout));
        if (code == THETABUS_TIMEOUT)
            return std::nullopt;
        check(code);
        return message;
    }

    /// CLOCK_MONOTONIC at sending of the last message, in ns.
    uint64_t sent_ns() const { return sent_ns_; }

private:
    struct Closer {
        void operator()(Handle *handle) const { Close(handle); }
    };
    std::unique_ptr<Handle, Closer> handle_;
    uint64_t sent_ns_ = 0;
};

} // namespace detail

/// A value that may be used, with its standard deviation.
struct Usable {
    double value;
    double std;
};

/// An estimate with its evidence.
struct Estimate : thetabus_estimate_t {
    /// Parameter `index`, from 0, if it may be used.
    std::optional<Usable> get(uint32_t index) const {
        if (!thetabus_is_usable(this, index))
            return std::nullopt;
        return Usable{theta[index], theta_std[index]};
    }
};

/// Names, units, meanings and bounds.
struct Description : thetabus_description_t {
    std::string model_name() const { return detail::text(model); }
    std::string name(uint32_t index) const { return detail::text(parameter[index].name); }
    std::string unit(uint32_t index) const { return detail::text(parameter[index].unit); }
    /// Index of the parameter of this name, from 0.
    std::optional<uint32_t> find(const std::string &name) const {
        const int32_t index = thetabus_find_parameter(this, name.c_str());
        return index < 0 ? std::nullopt : std::optional<uint32_t>(static_cast<uint32_t>(index));
    }
};

static_assert(sizeof(Estimate) == sizeof(thetabus_estimate_t) && sizeof(Description) == sizeof(thetabus_description_t),
              "the wrappers add functions only");

namespace detail {
inline int32_t next_estimate(thetabus_estimates_t *r, Estimate *m, uint64_t *t, int32_t l) {
    return thetabus_estimates_next(r, m, t, l);
}
inline int32_t next_description(thetabus_descriptions_t *r, Description *m, uint64_t *t, int32_t l) {
    return thetabus_descriptions_next(r, m, t, l);
}
} // namespace detail

using Estimates = detail::Reader<thetabus_estimates_t, Estimate, thetabus_estimates_open, detail::next_estimate,
                                 thetabus_estimates_close>;
using Statuses = detail::Reader<thetabus_statuses_t, thetabus_status_t, thetabus_statuses_open, thetabus_statuses_next,
                                thetabus_statuses_close>;
using Descriptions = detail::Reader<thetabus_descriptions_t, Description, thetabus_descriptions_open,
                                    detail::next_description, thetabus_descriptions_close>;
using Commands = detail::Reader<thetabus_commands_t, thetabus_machine_command_t, thetabus_commands_open,
                                thetabus_commands_next, thetabus_commands_close>;
using Samples = detail::Reader<thetabus_samples_t, thetabus_sample_t, thetabus_samples_open, thetabus_samples_next,
                               thetabus_samples_close>;

/// Takes the place of the plant of a robot.
class Machine {
public:
    /// With `consumers` above 0, for a simulation, waits until so many programs listen, `timeout` at most.
    explicit Machine(uint32_t joints, const std::string &robot = "arm", const std::string &domain = "default",
                     uint32_t consumers = 0, Milliseconds timeout = std::chrono::seconds(10)) {
        thetabus_machine_t *handle = nullptr;
        detail::check(thetabus_machine_open(domain.c_str(), robot.c_str(), joints, consumers, detail::limit(timeout),
                                            &handle));
        handle_.reset(handle);
    }

    /// Sends a sample and gives its seq; set `signals`, their arrays, `t_ns` (UINT64_MAX: now) and `flags`.
    uint64_t publish(thetabus_sample_t &sample) {
        detail::check(thetabus_machine_publish(handle_.get(), &sample));
        return sample.seq;
    }

    /// Counts samples that could not be measured.
    void skip(uint64_t samples) { detail::check(thetabus_machine_skip(handle_.get(), samples)); }

private:
    struct Closer {
        void operator()(thetabus_machine_t *handle) const { thetabus_machine_close(handle); }
    };
    std::unique_ptr<thetabus_machine_t, Closer> handle_;
};

/// Sends feed-forward to the machine in answer to its samples.
class Controller {
public:
    explicit Controller(const std::string &robot = "arm", const std::string &domain = "default") {
        thetabus_controller_t *handle = nullptr;
        detail::check(thetabus_controller_open(domain.c_str(), robot.c_str(), &handle));
        handle_.reset(handle);
    }

    /// Input to be added from the sample after this one on, for `hold` at most.
    void send(const thetabus_sample_t &sample, const std::vector<double> &feed_forward, Milliseconds hold) {
        if (feed_forward.size() != sample.joints)
            throw std::invalid_argument("feed_forward: expected a number for each joint");
        thetabus_machine_command_t command{};
        command.stream_id = sample.stream_id;
        command.seq = sample.seq;
        command.joints = sample.joints;
        command.until_ns = sample.t_ns + static_cast<uint64_t>(hold.count()) * 1000000u;
        std::copy(feed_forward.begin(), feed_forward.end(), command.feed_forward);
        detail::check(thetabus_controller_send(handle_.get(), &command));
    }

private:
    struct Closer {
        void operator()(thetabus_controller_t *handle) const { thetabus_controller_close(handle); }
    };
    std::unique_ptr<thetabus_controller_t, Closer> handle_;
};

/// Tells the identifier of a robot what to do; a refusal is thrown with its words.
class Control {
public:
    explicit Control(const std::string &robot = "arm", const std::string &domain = "default",
                     Milliseconds timeout = std::chrono::seconds(3))
        : timeout_(timeout) {
        thetabus_control_t *handle = nullptr;
        detail::check(thetabus_control_open(domain.c_str(), robot.c_str(), &handle));
        handle_.reset(handle);
    }

    void pause() { ask(THETABUS_PAUSE); }
    void resume() { ask(THETABUS_RESUME); }
    void reset() { ask(THETABUS_RESET); }
    void set(const std::string &tunable, double value) { ask(THETABUS_SET, tunable, value); }
    /// At a value, or at its estimate.
    void fix(const std::string &parameter, std::optional<double> value = std::nullopt) {
        ask(THETABUS_FIX, parameter, value.value_or(std::nan("")));
    }
    void free(const std::string &parameter) { ask(THETABUS_FREE, parameter); }
    void save() { ask(THETABUS_SAVE); }
    /// What the flange of a robot carries: mass in kg, 0 for nothing, centre of mass in m, inertia about it in kg m^2 as xx,
    /// xy, yy, xz, yz, zz, or that of a ball of light metal.
    void payload(double mass_kg, const std::array<double, 3> &center_m = {},
                 const std::optional<std::array<double, 6>> &inertia_kg_m2 = std::nullopt) {
        detail::check(thetabus_control_payload(handle_.get(), mass_kg, center_m.data(),
                                               inertia_kg_m2 ? inertia_kg_m2->data() : nullptr, nullptr,
                                               detail::limit(timeout_)));
    }

    /// Any command; the answer is large, so it lies on the heap.
    std::unique_ptr<thetabus_response_t> ask(uint32_t command, const std::string &name = "",
                                             double value = std::nan(""), uint64_t from_seq = 0) {
        auto response = std::make_unique<thetabus_response_t>();
        detail::check(thetabus_control_ask(handle_.get(), command, name.c_str(), value, from_seq, response.get(),
                                           detail::limit(timeout_)));
        return response;
    }

private:
    struct Closer {
        void operator()(thetabus_control_t *handle) const { thetabus_control_close(handle); }
    };
    std::unique_ptr<thetabus_control_t, Closer> handle_;
    Milliseconds timeout_;
};

} // namespace thetabus

#endif
