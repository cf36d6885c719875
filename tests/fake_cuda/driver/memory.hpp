// Memory that knows of each byte whether it may be touched and whether it was written, and of each word who
// touched it last.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>

namespace fake {

enum State : uint8_t { kOutside = 0, kUnwritten = 1, kWritten = 2, kFreed = 3 };

// The last access to a word: when, and by whom (see races.hpp).
struct Record {
    uint32_t stamp;
    uint32_t who;
};

// A stretch of addresses. All arrays come zeroed from the system and cost nothing until they are touched.
struct Region {
    uint64_t base = 0;
    uint64_t size = 0;
    uint8_t* data = nullptr;
    uint8_t* state = nullptr;
    Record* writers = nullptr;  // one per four bytes
    Record* readers = nullptr;

    Region(uint64_t base, uint64_t size);
    ~Region();
    Region(const Region&) = delete;
    Region& operator=(const Region&) = delete;

    bool holds(uint64_t address, uint64_t bytes) const { return address >= base && address - base <= size - bytes; }
};

// The state of `bytes` bytes: the worst of them, where outside is worst and written is best.
State worst_state(const uint8_t* state, uint64_t bytes);

// Device memory: allocations with red zones. Addresses of freed memory are handed out again only once all others
// were used, so that late accesses are seen.
class DeviceMemory {
   public:
    explicit DeviceMemory(uint64_t capacity);

    // Address of `bytes` bytes, 0 if there are none left.
    uint64_t allocate(uint64_t bytes);
    bool release(uint64_t address);
    bool range_of(uint64_t address, uint64_t* start, uint64_t* bytes) const;

    // The host's view of bytes that are all inside one allocation, else null.
    uint8_t* view(uint64_t address, uint64_t bytes);
    void mark_written(uint64_t address, uint64_t bytes);
    uint64_t count_unwritten(uint64_t address, uint64_t bytes) const;
    void copy(uint64_t to, uint64_t from, uint64_t bytes);

    // Where an address lies, in words.
    std::string describe(uint64_t address) const;

    uint64_t used() const { return used_; }
    uint64_t capacity() const { return capacity_; }

    Region region;

   private:
    uint64_t find_gap(uint64_t bytes) const;

    uint64_t capacity_;
    uint64_t used_ = 0;
    uint64_t next_;
    std::map<uint64_t, uint64_t> live_;  // address, bytes
};

}  // namespace fake
