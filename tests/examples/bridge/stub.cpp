// The bridge of the golden messages, and an echo of MessagePack, in C++.
//
//     stub tcp://127.0.0.1:9000
//     stub 0 tcp://127.0.0.1:9000     with so many seconds of patience for silent workers
//     stub echo < message > message

#include <iterator>

#include "eigenfail_bridge.hpp"

using namespace eigenfail;

namespace {

// The episodes of the golden answers: the one of planner idm fails in its first step.
class Golden : public Episode {
public:
    explicit Golden(const Start& start) : fails_(start.planner == "idm") {
        truth_.ego = {0.0, 0.0, 0.0, 24.0, 16.5, 2.5};
        truth_.others = {{100.0, 4.0, 0.0, 12.5, 4.5, 1.8}};
        truth_.ids = {whole(1)};
        truth_.signals = {{"planned_gap_m", {20.0}}};
    }

    Truth truth() const override { return truth_; }

    void step(const Disturbances& disturbances) override {
        if (fails_) throw Fault("planner", "It looked away.");
        const Vehicle other = truth_.others[nearest(truth_)];
        truth_.ego.x_m = 2.375;
        truth_.others.push_back(other);
        truth_.collided = truth_.off_road = true;
        truth_.perceived = Pair{other.x_m + disturbances["longitudinal"],
                                other.y_m + disturbances["lateral"]};
        truth_.control = Pair{-7.5, 0.01};
        truth_.applied = Pair{-7.0, 0.01};
        truth_.ids = {whole(2), whole(1)};
        truth_.signals = {{"planned_gap_m", {19.5}}};
        truth_.account = {{"heeds", text("lead")}, {"gap_m", {81.0}}};
        truth_.path = {{2.375, 0.0}, {26.0, 0.0}};
    }

private:
    bool fails_;
    Truth truth_;
};

Description description() {
    Map of_truck{{"distance_m", {55.0}}, {"wet", {true}}, {"kind", text("truck")},
                 {"lanes", whole(2)}};
    return {"stub", "1.0", 2, {{"cut_in", 0.1, 100, std::move(of_truck)}},
            {{"rulebook", {{"beside_m", {6.0}}}}, {"idm", {}}},
            {"lateral", "ghost"},
            {{"planned_gap_m", "m", "gap that the planner keeps"}}};
}

int echo() {
    std::string message(std::istreambuf_iterator<char>(std::cin), {});
    try {
        std::cout << Writer::write(Reader::read(message));
        return 0;
    } catch (const std::invalid_argument&) {
        return 1;
    }
}

}  // namespace

int main(int count, char** words) {
    if (std::string(words[1]) == "echo") return echo();
    std::chrono::seconds patience(count == 3 ? std::stoi(words[1]) : 60);
    Bridge bridge(
        description(), [](const Start& start) { return std::make_unique<Golden>(start); }, patience);
    serve(words[count - 1], bridge);
}
