#include "access.hpp"

#include <cstdio>

namespace fake {
namespace {

const char* name_of(Space space) {
    const char* names[] = {"generic", "global", "shared", "local", "param"};
    return names[static_cast<size_t>(space)];
}

std::string in_hex(uint64_t value) {
    char text[32];
    std::snprintf(text, sizeof text, "0x%llx", static_cast<unsigned long long>(value));
    return text;
}

std::string describe_shared(const Block& block, uint64_t address) {
    const Launch& launch = block.launch;
    const SharedVariable* nearest = nullptr;
    const auto look = [&](const std::vector<SharedVariable>& list) {
        for (const auto& v : list)
            if (v.offset <= address && (!nearest || v.offset > nearest->offset)) nearest = &v;
    };
    look(launch.program.shared);
    look(launch.kernel.shared);
    for (const Function& f : launch.program.functions)
        if (!f.kernel) look(f.shared);
    if (address >= kDynamicShared)
        return "byte " + std::to_string(address - kDynamicShared) + " of " + std::to_string(launch.dynamic_shared) +
               " dynamic bytes";
    if (!nearest) return "before every variable";
    return "byte " + std::to_string(address - nearest->offset) + " of '" + nearest->name + "', which has " +
           std::to_string(nearest->bytes);
}

[[noreturn]] void report(Warp& w, int lane, int code, const Access& a, const std::string& what, bool writes) {
    const DeviceMemory& memory = w.block.launch.memory;
    std::string where = in_hex(a.address);
    if (a.space == Space::global) where += ", " + memory.describe(a.address);
    if (a.space == Space::shared) where = describe_shared(w.block, a.address);
    fail(w, lane, code,
         what + ": " + name_of(a.space) + (writes ? " write" : " read") + " of " + std::to_string(a.bytes) +
             " bytes at " + where);
}

template <class T>
bool all_are(const uint8_t* state, uint64_t pattern) {
    T found;
    std::memcpy(&found, state, sizeof found);
    return found == static_cast<T>(pattern);
}

bool all_written(const uint8_t* state, uint32_t bytes) {
    constexpr uint64_t pattern = 0x0202020202020202ull;
    if (bytes == 4) return all_are<uint32_t>(state, pattern);
    if (bytes == 8) return all_are<uint64_t>(state, pattern);
    return worst_state(state, bytes) == kWritten;
}

void check_state(Warp& w, int lane, const Access& a, Region& region, bool writes) {
    if (a.address & (a.bytes - 1)) report(w, lane, kMisaligned, a, "misaligned", writes);
    if (!region.holds(a.address, a.bytes)) report(w, lane, kIllegalAddress, a, "out of bounds", writes);
    const uint8_t* state = region.state + (a.address - region.base);
    if (all_written(state, a.bytes)) return;
    const State worst = worst_state(state, a.bytes);
    if (worst == kOutside) report(w, lane, kIllegalAddress, a, "out of bounds", writes);
    if (worst == kFreed) report(w, lane, kIllegalAddress, a, "freed memory", writes);
    if (!writes) report(w, lane, kLaunchFailed, a, "never written", writes);
}

uint32_t word_bytes(const Access& a) { return a.bytes >= 4 ? 0xf : ((1u << a.bytes) - 1) << (a.address & 3); }

void report_race(Warp& w, int lane, const Access& a, Race race, bool writes) {
    report(w, lane, kLaunchFailed, a, race == Race::within_block ? "race within the block" : "race between blocks",
           writes);
}

Visitor visitor_for(Warp& w, int lane, const Instruction& i, Space space) {
    Visitor v = w.block.visitor;
    v.thread = w.first + static_cast<uint32_t>(lane);
    v.warp_epoch = w.epoch;
    v.strong = i.strong;
    if (space == Space::shared) v.launch = v.block;
    return v;
}

Region& region_of(Warp& w, Space space) {
    return space == Space::shared ? w.block.launch.shared : w.block.launch.memory.region;
}

// Memory that only this thread sees, or that nobody writes.
uint8_t* private_bytes(Warp& w, int lane, const Access& a, bool writes) {
    Launch& launch = w.block.launch;
    if (a.address & (a.bytes - 1)) report(w, lane, kMisaligned, a, "misaligned", writes);
    if (a.space == Space::param) {
        if (writes || a.address + a.bytes > launch.params.size())
            report(w, lane, kIllegalAddress, a, "out of bounds", writes);
        return const_cast<uint8_t*>(launch.params.data()) + a.address;
    }
    const auto& valid = launch.program.local_valid;
    for (uint64_t k = a.address; k < a.address + a.bytes; ++k)
        if (k >= valid.size() || !valid[k]) report(w, lane, kIllegalAddress, a, "out of bounds", writes);
    return w.block.local.data() + uint64_t{w.first + static_cast<uint32_t>(lane)} * valid.size() + a.address;
}

}  // namespace

Access access_of(Warp& w, const Instruction& i, int lane) {
    uint64_t address = static_cast<uint64_t>(i.offset);
    if (i.width[1] == 8) address += w.lanes<uint64_t>(i.r[4])[lane];
    else if (i.width[1] == 4) address += w.lanes<uint32_t>(i.r[4])[lane];
    Access a{address, uint32_t{i.bytes} * i.count, i.space};
    if (a.space == Space::generic) {
        const uint64_t window = address >> 48;
        a.space = window == 1 ? Space::shared : window == 2 ? Space::local : window == 3 ? Space::param : Space::global;
        a.address &= (1ull << 48) - 1;
        if (window > 3) a.address = address;
    }
    return a;
}

uint8_t* reach_read(Warp& w, const Instruction& i, int lane, const Access& a) {
    if (a.space == Space::local || a.space == Space::param) return private_bytes(w, lane, a, false);
    Launch& launch = w.block.launch;
    Region& region = region_of(w, a.space);
    check_state(w, lane, a, region, false);
    const uint64_t at = a.address - region.base;
    if (launch.settings.find_races) {
        const Visitor v = visitor_for(w, lane, i, a.space);
        for (uint64_t word = at / 4; word <= (at + a.bytes - 1) / 4; ++word) {
            const Race race = note_read(region, word, v, word_bytes(a));
            if (race != Race::none) report_race(w, lane, a, race, false);
        }
    }
    if (!i.uncounted) (a.space == Space::shared ? launch.counters.shared_read : launch.counters.global_read) += a.bytes;
    return region.data + at;
}

uint8_t* reach_write(Warp& w, const Instruction& i, int lane, const Access& a, const uint8_t* value) {
    if (a.space == Space::local || a.space == Space::param) return private_bytes(w, lane, a, true);
    Launch& launch = w.block.launch;
    Region& region = region_of(w, a.space);
    check_state(w, lane, a, region, true);
    const uint64_t at = a.address - region.base;
    if (launch.settings.find_races) {
        const bool changes = !value || std::memcmp(region.data + at, value, a.bytes) != 0;
        const Visitor v = visitor_for(w, lane, i, a.space);
        for (uint64_t word = at / 4; word <= (at + a.bytes - 1) / 4; ++word) {
            const Race race = note_write(region, word, v, word_bytes(a), changes);
            if (race != Race::none) report_race(w, lane, a, race, true);
        }
    }
    std::memset(region.state + at, kWritten, a.bytes);
    (a.space == Space::shared ? launch.counters.shared_written : launch.counters.global_written) += a.bytes;
    return region.data + at;
}

void take_address(Decoder& d, const Operand& operand) {
    if (operand.form != Operand::address) d.reject("an address in brackets expected");
    d.out.offset = operand.offset;
    d.out.width[1] = 0;
    if (operand.text.empty()) return;
    const Symbol* symbol = d.symbol_of(operand);
    if (!symbol) d.reject("nothing is called '" + operand.text + "'");
    if (symbol->form == Symbol::reg) {
        d.out.width[1] = symbol->bytes;
        d.out.r[4] = static_cast<uint32_t>(symbol->where);
        return;
    }
    d.out.offset += static_cast<int64_t>(symbol->where);
    constexpr Space spaces[] = {Space::generic, Space::global, Space::shared, Space::local, Space::param};
    d.out.space = spaces[static_cast<size_t>(symbol->form)];
}

void take_strength(Decoder& d) {
    for (const char* strong : {"volatile", "relaxed", "acquire", "release", "acq_rel", "mmio"})
        if (d.take(strong)) d.out.strong = true;
    for (const char* other : {"weak",
                              "cta",
                              "gpu",
                              "sys",
                              "cluster",
                              "ca",
                              "cg",
                              "cs",
                              "lu",
                              "cv",
                              "wb",
                              "wt",
                              "nc",
                              "L1::evict_normal",
                              "L1::evict_unchanged",
                              "L1::evict_first",
                              "L1::evict_last",
                              "L1::no_allocate",
                              "L2::64B",
                              "L2::128B",
                              "L2::256B"})
        d.take(other);
}

}  // namespace fake
