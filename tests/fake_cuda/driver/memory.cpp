#include "memory.hpp"

#include <sys/mman.h>

#include <algorithm>
#include <cstring>
#include <new>

namespace fake {
namespace {

constexpr uint64_t kDeviceBase = 1ull << 40;  // no host address looks like it
constexpr uint64_t kAddresses = 16ull << 30;
constexpr uint64_t kAlignment = 512;
constexpr uint64_t kRedZone = 512;

template <class T>
T* reserve(uint64_t count) {
    void* memory =
        mmap(nullptr, count * sizeof(T), PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (memory == MAP_FAILED) throw std::bad_alloc();
    return static_cast<T*>(memory);
}

uint64_t with_zone(uint64_t bytes) { return (bytes + kAlignment - 1) / kAlignment * kAlignment + kRedZone; }

// Gives whole pages back to the system; they read as zeros afterwards.
void forget(void* start, uint64_t bytes) {
    const uint64_t page = 4096;
    const uint64_t first = (reinterpret_cast<uint64_t>(start) + page - 1) / page * page;
    const uint64_t last = (reinterpret_cast<uint64_t>(start) + bytes) / page * page;
    if (last > first) madvise(reinterpret_cast<void*>(first), last - first, MADV_DONTNEED);
}

}  // namespace

Region::Region(uint64_t base, uint64_t size)
    : base(base),
      size(size),
      data(reserve<uint8_t>(size)),
      state(reserve<uint8_t>(size)),
      writers(reserve<Record>(size / 4 + 1)),
      readers(reserve<Record>(size / 4 + 1)) {}

Region::~Region() {
    munmap(data, size);
    munmap(state, size);
    munmap(writers, (size / 4 + 1) * sizeof(Record));
    munmap(readers, (size / 4 + 1) * sizeof(Record));
}

State worst_state(const uint8_t* state, uint64_t bytes) {
    uint8_t worst = kWritten;
    for (uint64_t i = 0; i < bytes; ++i) {
        if (state[i] == kFreed) return kFreed;
        worst = std::min(worst, state[i]);
    }
    return static_cast<State>(worst);
}

DeviceMemory::DeviceMemory(uint64_t capacity)
    : region(kDeviceBase, kAddresses), capacity_(capacity), next_(kDeviceBase + kRedZone) {}

uint64_t DeviceMemory::allocate(uint64_t bytes) {
    if (used_ + bytes > capacity_) return 0;
    uint64_t address = next_;
    if (next_ + with_zone(bytes) <= region.base + region.size) {
        next_ += with_zone(bytes);
    } else {
        address = find_gap(bytes);
        if (!address) return 0;
    }
    std::memset(region.state + (address - region.base), kUnwritten, bytes);
    live_[address] = bytes;
    used_ += bytes;
    return address;
}

uint64_t DeviceMemory::find_gap(uint64_t bytes) const {
    uint64_t start = region.base + kRedZone;
    for (const auto& [address, size] : live_) {
        if (start + with_zone(bytes) <= address) return start;
        start = address + with_zone(size);
    }
    return start + with_zone(bytes) <= region.base + region.size ? start : 0;
}

bool DeviceMemory::release(uint64_t address) {
    const auto found = live_.find(address);
    if (found == live_.end()) return false;
    const uint64_t at = address - region.base;
    std::memset(region.state + at, kFreed, found->second);
    forget(region.data + at, found->second);
    forget(region.writers + at / 4, found->second / 4 * sizeof(Record));
    forget(region.readers + at / 4, found->second / 4 * sizeof(Record));
    used_ -= found->second;
    live_.erase(found);
    return true;
}

bool DeviceMemory::range_of(uint64_t address, uint64_t* start, uint64_t* bytes) const {
    auto after = live_.upper_bound(address);
    if (after == live_.begin()) return false;
    --after;
    if (address >= after->first + std::max<uint64_t>(after->second, 1)) return false;
    *start = after->first;
    *bytes = after->second;
    return true;
}

uint8_t* DeviceMemory::view(uint64_t address, uint64_t bytes) {
    uint64_t start = 0;
    uint64_t size = 0;
    if (!range_of(address, &start, &size) || address + bytes > start + size) return nullptr;
    return region.data + (address - region.base);
}

void DeviceMemory::mark_written(uint64_t address, uint64_t bytes) {
    std::memset(region.state + (address - region.base), kWritten, bytes);
}

uint64_t DeviceMemory::count_unwritten(uint64_t address, uint64_t bytes) const {
    const uint8_t* state = region.state + (address - region.base);
    return static_cast<uint64_t>(std::count(state, state + bytes, static_cast<uint8_t>(kUnwritten)));
}

void DeviceMemory::copy(uint64_t to, uint64_t from, uint64_t bytes) {
    std::memmove(region.data + (to - region.base), region.data + (from - region.base), bytes);
    std::memmove(region.state + (to - region.base), region.state + (from - region.base), bytes);
}

std::string DeviceMemory::describe(uint64_t address) const {
    if (address < region.base || address >= region.base + region.size) return "no device address";
    auto after = live_.upper_bound(address);
    if (after != live_.begin()) {
        const auto before = std::prev(after);
        const uint64_t end = before->first + before->second;
        if (address < end) return "in an allocation of " + std::to_string(before->second) + " bytes";
        if (address < end + kRedZone || after == live_.end())
            return std::to_string(address - end) + " bytes past the end of an allocation of " +
                   std::to_string(before->second) + " bytes";
    }
    if (after == live_.end()) return "outside of every allocation";
    return std::to_string(after->first - address) + " bytes before an allocation of " + std::to_string(after->second) +
           " bytes";
}

}  // namespace fake
