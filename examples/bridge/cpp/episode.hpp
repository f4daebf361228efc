// What a bridge is made of: yours are the episodes, and what the bridge says of itself.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include "messagepack.hpp"

namespace eigenfail {

struct Vehicle {
    double x_m, y_m, heading_rad, speed_mps, length_m, width_m;
};

struct Pair {
    double first, second;
};

// What is true now; what the planner saw and did is told after a step. What follows `off_road` is
// optional: ids of vehicles that come and go, values of the signals by name, and, if the campaign
// asks for it, what the planner believes and where it means to drive.
struct Truth {
    Vehicle ego;
    std::vector<Vehicle> others;
    bool collided = false;
    std::optional<Pair> perceived, control, applied;
    bool off_road = false;
    List ids;
    Map signals, account;
    std::vector<Pair> path;
};

// The value of each channel of an episode in a step; 0 of one that the campaign does not name.
struct Disturbances {
    Map values;

    double operator[](std::string_view channel) const {
        for (const auto& [name, value] : values)
            if (name == channel) return value.number();
        return 0.0;
    }
};

// Throw it for what is not the simulator's fault: "planner", "solver" or "input".
struct Fault : std::runtime_error {
    Fault(std::string whose, const std::string& message)
        : std::runtime_error(message), whose(std::move(whose)) {}
    std::string whose;
};

// One episode, from its start; yours. Counting steps and ending is the bridge's.
class Episode {
public:
    virtual ~Episode() = default;
    virtual Truth truth() const = 0;
    virtual void step(const Disturbances& disturbances) = 0;
};

// Of a reset: what is to begin. Parameters and settings are complete: defaults, or what was set,
// each of the kind of its default. Channels are maps with a name, that of a ghost with ahead_m.
struct Start {
    std::uint64_t seed;
    std::string scenario;
    Value parameters;
    std::string planner;
    Value settings;
    List channels;
};

struct Scenario {
    std::string name;
    double dt_s;
    std::uint64_t steps;
    Map parameters;
};

struct Planner {
    std::string name;
    Map settings;
};

struct Signal {
    std::string name, unit, words;
};

// Without channels, those of the position.
struct Description {
    std::string name, version;
    std::uint64_t slots;
    std::vector<Scenario> scenarios;
    std::vector<Planner> planners;
    std::vector<std::string> channels;
    std::vector<Signal> signals;

    // A bridge that disturbs every.speed disturbs vehicle_2.speed.
    bool disturbs(const std::string& channel) const {
        auto offers = [&](const std::string& name) {
            if (channels.empty()) return name == "longitudinal" || name == "lateral";
            return std::find(channels.begin(), channels.end(), name) != channels.end();
        };
        auto dot = channel.find('.');
        return offers(channel) || (channel.rfind("vehicle_", 0) == 0 && dot != channel.npos &&
                                   offers("every" + channel.substr(dot)));
    }
};

// Which vehicle's perceived position is disturbed: the nearest by its centre, of equals the first.
inline std::size_t nearest(const Truth& truth) {
    auto away = [&](const Vehicle& one) {
        return std::hypot(one.x_m - truth.ego.x_m, one.y_m - truth.ego.y_m);
    };
    auto nearer = [&](const Vehicle& one, const Vehicle& other) { return away(one) < away(other); };
    auto found = std::min_element(truth.others.begin(), truth.others.end(), nearer);
    return static_cast<std::size_t>(found - truth.others.begin());
}

}  // namespace eigenfail
