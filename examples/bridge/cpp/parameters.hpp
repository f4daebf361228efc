// What a campaign sets, in the place of the defaults; each has to be of the kind of its default.
#pragma once

#include "episode.hpp"

namespace eigenfail {

inline bool is_number(const Value& value) {
    return value.is.index() >= Value{std::uint64_t{}}.is.index() &&
           value.is.index() <= Value{double{}}.is.index();
}

// A number without a fraction, of those that a double holds exactly.
inline bool is_whole(const Value& value) {
    constexpr double most = 9007199254740992.0;
    return is_number(value) && std::abs(value.number()) <= most &&
           std::trunc(value.number()) == value.number();
}

inline Value whole_of(const Value& value) {
    double number = value.number();
    if (number < 0.0) return {static_cast<std::int64_t>(number)};
    return {static_cast<std::uint64_t>(number)};
}

// The value as its default is: any number for a number, one without a fraction for a whole one.
inline Value like(const Value& standard, const std::string& name, const Value& given) {
    bool fraction = std::holds_alternative<double>(standard.is);
    if (is_number(standard) && fraction && is_number(given)) return {given.number()};
    if (is_number(standard) && !fraction && is_whole(given)) return whole_of(given);
    if (!is_number(standard) && standard.is.index() == given.is.index()) return given;
    throw Fault("input", "'" + name + "' has to be " + standard.kind() + ", and not " +
                             given.kind() + ".");
}

// What came from outside, as a message may hold it: a name may be no UTF-8.
inline std::string in_words(std::string name) {
    std::replace_if(name.begin(), name.end(), [](char one) { return one < ' ' || one > '~'; }, '?');
    return name.substr(0, 200);
}

// The defaults, with what was set in their place.
inline Map filled(Map defaults, const Value& given) {
    for (const auto& [name, value] : given.map()) {
        auto is_it = [&name = name](const auto& pair) { return pair.first == name; };
        auto found = std::find_if(defaults.begin(), defaults.end(), is_it);
        if (found == defaults.end())
            throw Fault("input", "There is no parameter '" + in_words(name) + "'.");
        found->second = like(found->second, name, value);
    }
    return defaults;
}

}  // namespace eigenfail
