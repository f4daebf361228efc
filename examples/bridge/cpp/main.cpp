// An example of a bridge: a truck that keeps its distance behind a car that brakes. Its position
// and its speed may be seen wrongly, and it may be missed.
//
//     ./bridge tcp://127.0.0.1:9000

#include "eigenfail_bridge.hpp"

using namespace eigenfail;

namespace {

constexpr double dt_s = 0.1;
constexpr double lane_half_width_m = 2.0;
constexpr double strongest_brakes_mps2 = 6.0, strongest_gas_mps2 = 1.5;

double gap_m(const Vehicle& ego, const Vehicle& lead) {
    return lead.x_m - ego.x_m - (lead.length_m + ego.length_m) / 2.0;
}

// The planner: keeps a time headway behind whom it sees in its lane.
struct Headway {
    double headway_s, standstill_m, cruise_mps;

    double wanted_gap_m(const Vehicle& ego) const {
        return standstill_m + headway_s * ego.speed_mps;
    }

    double acceleration_mps2(const Vehicle& ego, const std::optional<Vehicle>& seen) const {
        double free = 0.5 * (cruise_mps - ego.speed_mps);
        if (!seen || std::abs(seen->y_m - ego.y_m) > lane_half_width_m) return free;
        double missing_m = gap_m(ego, *seen) - standstill_m - headway_s * ego.speed_mps;
        return std::min(free, 0.4 * missing_m + 1.2 * (seen->speed_mps - ego.speed_mps));
    }
};

// The simulator: two point masses on a straight lane.
class BrakingLead : public Episode {
public:
    explicit BrakingLead(const Start& start)
        : planner_{start.settings["headway_s"].number(), start.settings["standstill_m"].number(),
                   start.parameters["speed_mps"].number()},
          brakes_at_s_(start.parameters["brakes_at_s"].number()),
          deceleration_mps2_(start.parameters["deceleration_mps2"].number()) {
        double speed_mps = planner_.cruise_mps;
        if (speed_mps <= 0.0) throw Fault("input", "speed_mps has to be above 0.");
        truth_.ego = {0.0, 0.0, 0.0, speed_mps, 12.0, 2.5};
        double centres_m = 8.5 + planner_.standstill_m + planner_.headway_s * speed_mps;
        truth_.others = {{centres_m, 0.0, 0.0, speed_mps, 5.0, 1.8}};
        tell_signals();
    }

    Truth truth() const override { return truth_; }

    void step(const Disturbances& disturbances) override {
        Vehicle& ego = truth_.ego;
        Vehicle& lead = truth_.others[0];
        std::optional<Vehicle> seen = lead;
        seen->x_m += disturbances["longitudinal"];
        seen->y_m += disturbances["lateral"];
        seen->speed_mps += disturbances["speed"];
        if (disturbances["missed"] > 0.5) seen.reset();
        double asked = planner_.acceleration_mps2(ego, seen);
        double given = std::clamp(asked, -strongest_brakes_mps2, strongest_gas_mps2);
        move(ego, given);
        move(lead, time_s_ < brakes_at_s_ ? 0.0 : -deceleration_mps2_);
        time_s_ += dt_s;
        truth_.perceived.reset();
        if (seen) truth_.perceived = Pair{seen->x_m, seen->y_m};
        truth_.control = Pair{asked, 0.0};
        truth_.applied = Pair{given, 0.0};
        truth_.collided = gap_m(ego, lead) <= 0.0;
        truth_.account = {{"heeds", text(seen ? "lead" : "nobody")},
                          {"gap_m", {seen ? gap_m(ego, *seen) : 0.0}}};
        truth_.path = {{ego.x_m, 0.0}, {ego.x_m + 2.0 * ego.speed_mps, 0.0}};
        tell_signals();
    }

private:
    void tell_signals() {
        truth_.signals = {{"wanted_gap_m", {planner_.wanted_gap_m(truth_.ego)}}};
    }

    static void move(Vehicle& one, double acceleration_mps2) {
        one.speed_mps = std::max(one.speed_mps + acceleration_mps2 * dt_s, 0.0);
        one.x_m += one.speed_mps * dt_s;
    }

    Headway planner_;
    double brakes_at_s_, deceleration_mps2_, time_s_ = 0.0;
    Truth truth_;
};

Description description() {
    return {"point masses in C++", "1", 32,
            {{"braking_lead", dt_s, 120,
              {{"speed_mps", {20.0}}, {"brakes_at_s", {2.0}}, {"deceleration_mps2", {5.0}}}}},
            {{"headway", {{"headway_s", {0.8}}, {"standstill_m", {1.0}}}}},
            {"longitudinal", "lateral", "speed", "missed"},
            {{"wanted_gap_m", "m", "gap that the planner keeps"}}};
}

}  // namespace

int main(int count, char** words) {
    if (count != 2) {
        std::cerr << "Say where to bind: " << words[0] << " tcp://127.0.0.1:9000\n";
        return 2;
    }
    try {
        Bridge bridge(description(),
                      [](const Start& start) { return std::make_unique<BrakingLead>(start); });
        serve(words[1], bridge);
    } catch (const std::exception& error) {
        std::cerr << error.what() << '\n';
        return 1;
    }
}
