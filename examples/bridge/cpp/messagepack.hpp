// MessagePack, as far as a bridge needs it: nil, booleans, numbers, texts, lists, maps.
// A message comes from outside: lengths are held against what is there before anything is reserved.
#pragma once

#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

namespace eigenfail {

struct Value;
using List = std::vector<Value>;
using Map = std::vector<std::pair<std::string, Value>>;

// Anything that can be said; a map keeps the order of its keys.
struct Value {
    std::variant<std::nullptr_t, bool, std::uint64_t, std::int64_t, double, std::string, List, Map>
        is = nullptr;

    double number() const {
        if (auto whole = std::get_if<std::uint64_t>(&is)) return static_cast<double>(*whole);
        if (auto below = std::get_if<std::int64_t>(&is)) return static_cast<double>(*below);
        return expect<double>("a number");
    }
    bool empty() const { return std::holds_alternative<std::nullptr_t>(is); }
    bool truth() const { return expect<bool>("a truth value"); }
    std::uint64_t whole() const { return expect<std::uint64_t>("a whole number from 0"); }
    const std::string& text() const { return expect<std::string>("a text"); }
    const List& list() const { return expect<List>("a list"); }
    const Map& map() const { return expect<Map>("a map"); }

    // What kind of thing it is, for people.
    const char* kind() const {
        static constexpr const char* kinds[] = {"nothing", "a truth value", "a whole number",
                                                "a whole number", "a number", "a text", "a list",
                                                "a map"};
        return kinds[is.index()];
    }

    // The value under a key; nil if there is none.
    const Value& operator[](std::string_view key) const {
        static const Value nil;
        for (const auto& [name, value] : map())
            if (name == key) return value;
        return nil;
    }

private:
    template <class T> const T& expect(const char* what) const {
        if (auto found = std::get_if<T>(&is)) return *found;
        throw std::invalid_argument(std::string("There is ") + kind() + " where " + what + " is due.");
    }
};

class Reader {
public:
    // The one value that these bytes are; throws std::invalid_argument for any others.
    static Value read(std::string_view bytes) {
        Reader reader(bytes);
        Value value = reader.value(0);
        if (!reader.left_.empty()) throw std::invalid_argument("The message has too many bytes.");
        return value;
    }

private:
    static constexpr int deepest = 16;

    explicit Reader(std::string_view bytes) : left_(bytes) {}

    std::string_view take(std::uint64_t length) {
        if (length > left_.size()) throw std::invalid_argument("The message ends too early.");
        auto taken = left_.substr(0, length);
        left_.remove_prefix(length);
        return taken;
    }

    std::uint64_t big_endian(int length) {
        std::uint64_t number = 0;
        for (unsigned char byte : take(static_cast<std::uint64_t>(length)))
            number = number << 8 | byte;
        return number;
    }

    // 2^exponent bytes
    std::uint64_t sized(int exponent) { return big_endian(1 << exponent); }

    template <class T, class Bits> T as(Bits bits) {
        static_assert(sizeof(T) == sizeof(Bits));
        T number;
        std::memcpy(&number, &bits, sizeof number);
        return number;
    }

    Value below_zero(int exponent) {
        int unused = 64 - (8 << exponent);
        auto number = as<std::int64_t>(sized(exponent) << unused) >> unused;
        if (number < 0) return {number};
        return {static_cast<std::uint64_t>(number)};
    }

    Value text(std::uint64_t length) { return {std::string(take(length))}; }

    Value list(std::uint64_t length, int depth) {
        if (length > left_.size()) throw std::invalid_argument("A list ends too early.");
        List values;
        values.reserve(length);
        while (values.size() < length) values.push_back(value(depth + 1));
        return {std::move(values)};
    }

    Value map(std::uint64_t length, int depth) {
        if (length > left_.size() / 2) throw std::invalid_argument("A map ends too early.");
        Map pairs;
        pairs.reserve(length);
        while (pairs.size() < length) {
            std::string key = value(depth + 1).text();
            pairs.emplace_back(std::move(key), value(depth + 1));
        }
        return {std::move(pairs)};
    }

    // What a key that nobody knows may hold beside the rest.
    Value passed_over(std::uint64_t length) {
        take(length);
        return {};
    }

    Value value(int depth) {
        if (depth > deepest) throw std::invalid_argument("The message is nested too deeply.");
        auto head = static_cast<int>(big_endian(1));
        if (head < 0x80) return {static_cast<std::uint64_t>(head)};
        if (head < 0x90) return map(head & 0x0f, depth);
        if (head < 0xa0) return list(head & 0x0f, depth);
        if (head < 0xc0) return text(head & 0x1f);
        if (head >= 0xe0) return {static_cast<std::int64_t>(head - 0x100)};
        return headed(head, depth);
    }

    Value headed(int head, int depth) {
        switch (head) {
        case 0xc0: return {};
        case 0xc2: case 0xc3: return {head == 0xc3};
        case 0xc4: case 0xc5: case 0xc6: return passed_over(sized(head - 0xc4));
        case 0xc7: case 0xc8: case 0xc9: return passed_over(sized(head - 0xc7) + 1);
        case 0xca: return {static_cast<double>(as<float>(static_cast<std::uint32_t>(sized(2))))};
        case 0xcb: return {as<double>(sized(3))};
        case 0xcc: case 0xcd: case 0xce: case 0xcf: return {sized(head - 0xcc)};
        case 0xd0: case 0xd1: case 0xd2: case 0xd3: return below_zero(head - 0xd0);
        case 0xd4: case 0xd5: case 0xd6: case 0xd7: case 0xd8:
            return passed_over((std::uint64_t{1} << (head - 0xd4)) + 1);
        case 0xd9: case 0xda: case 0xdb: return text(sized(head - 0xd9));
        case 0xdc: case 0xdd: return list(sized(head - 0xdb), depth);
        case 0xde: case 0xdf: return map(sized(head - 0xdd), depth);
        default: throw std::invalid_argument("The message holds what is no MessagePack.");
        }
    }

    std::string_view left_;
};

class Writer {
public:
    // The bytes of a value, as few as will do.
    static std::string write(const Value& value) {
        Writer writer;
        std::visit(writer, value.is);
        return std::move(writer.bytes_);
    }

    void operator()(std::nullptr_t) { big_endian(0xc0, 1); }
    void operator()(bool truth) { big_endian(truth ? 0xc3 : 0xc2, 1); }
    void operator()(double number) {
        std::uint64_t bits;
        std::memcpy(&bits, &number, sizeof bits);
        big_endian(0xcb, 1);
        big_endian(bits, 8);
    }
    void operator()(std::uint64_t number) {
        if (number < 0x80) return big_endian(number, 1);
        sized(0xcc, number, 0);
    }
    void operator()(std::int64_t number) {
        if (number >= 0) return (*this)(static_cast<std::uint64_t>(number));
        auto bits = static_cast<std::uint64_t>(number);
        if (number >= -32) return big_endian(bits & 0xff, 1);
        int exponent = 0;
        while (exponent < 3 && number >> ((8 << exponent) - 1) != -1) ++exponent;
        big_endian(static_cast<std::uint64_t>(0xd0 + exponent), 1);
        big_endian(bits, 1 << exponent);
    }
    void operator()(const std::string& text) {
        if (text.size() < 32) big_endian(0xa0 | text.size(), 1);
        else sized(0xd9, text.size(), 0);
        bytes_ += text;
    }
    void operator()(const List& values) {
        if (values.size() < 16) big_endian(0x90 | values.size(), 1);
        else sized(0xdb, values.size(), 1);
        for (const Value& value : values) std::visit(*this, value.is);
    }
    void operator()(const Map& pairs) {
        if (pairs.size() < 16) big_endian(0x80 | pairs.size(), 1);
        else sized(0xdd, pairs.size(), 1);
        for (const auto& [name, value] : pairs) {
            (*this)(name);
            std::visit(*this, value.is);
        }
    }

private:
    // The number in 2^exponent bytes, behind a head that says how many: as few as hold it.
    void sized(int head, std::uint64_t number, int exponent) {
        while (exponent < 3 && number >> (8 << exponent) != 0) ++exponent;
        big_endian(static_cast<std::uint64_t>(head + exponent), 1);
        big_endian(number, 1 << exponent);
    }
    void big_endian(std::uint64_t number, int length) {
        while (length-- > 0) bytes_ += static_cast<char>(number >> 8 * length & 0xff);
    }

    std::string bytes_;
};

}  // namespace eigenfail
