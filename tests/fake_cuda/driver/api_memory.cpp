// Allocations, copies, fills.
#include <cstdlib>
#include <cstring>

#include "driver.hpp"

using namespace fake;

namespace {

using Address = unsigned long long;

int allocate(Driver& d, Address* address, size_t bytes) {
    if (bytes == 0) return d.reject(kInvalidValue, "an allocation of 0 bytes");
    d.look_for_faults();
    if (d.failing_allocation.strikes()) return kOutOfMemory;
    *address = d.memory->allocate(bytes);
    if (!*address) return kOutOfMemory;
    ++d.host.allocations;
    return kSuccess;
}

int outside(Driver& d, const char* what) {
    return d.reject(kInvalidValue, std::string(what) + " reaches beyond its allocation");
}

int to_device(Driver& d, Address to, const void* from, size_t bytes) {
    uint8_t* data = d.memory->view(to, bytes);
    if (!data) return outside(d, "a copy to the device");
    std::memcpy(data, from, bytes);
    d.memory->mark_written(to, bytes);
    d.host.bytes_to_device += bytes;
    return kSuccess;
}

int to_host(Driver& d, void* to, Address from, size_t bytes) {
    const uint8_t* data = d.memory->view(from, bytes);
    if (!data) return outside(d, "a copy to the host");
    std::memcpy(to, data, bytes);
    d.host.bytes_to_host += bytes;
    d.host.unwritten_bytes_to_host += d.memory->count_unwritten(from, bytes);
    return kSuccess;
}

int on_device(Driver& d, Address to, Address from, size_t bytes) {
    if (!d.memory->view(to, bytes) || !d.memory->view(from, bytes)) return outside(d, "a copy on the device");
    d.memory->copy(to, from, bytes);
    return kSuccess;
}

// Pageable memory is read before the call returns.
int to_device_later(Driver& d, Address to, const void* from, size_t bytes) {
    if (!d.lazy || d.is_pinned(from, bytes)) return d.submit([=, &d] { return to_device(d, to, from, bytes); });
    const auto* start = static_cast<const uint8_t*>(from);
    return d.submit([&d, to, bytes, copy = std::vector<uint8_t>(start, start + bytes)] {
        return to_device(d, to, copy.data(), bytes);
    });
}

// Pageable memory is written before the call returns.
int to_host_later(Driver& d, void* to, Address from, size_t bytes) {
    if (d.is_pinned(to, bytes)) return d.submit([=, &d] { return to_host(d, to, from, bytes); });
    const int result = d.synchronise();
    return result ? result : to_host(d, to, from, bytes);
}

template <class F>
int after_all(Driver& d, F f) {
    const int result = d.synchronise();
    return result ? result : f();
}

template <class T>
int fill(Driver& d, Address to, size_t pitch, T value, size_t width, size_t height) {
    return d.submit([=, &d] {
        for (size_t y = 0; y < height; ++y) {
            auto* data = reinterpret_cast<T*>(d.memory->view(to + y * pitch, width * sizeof(T)));
            if (!data) return outside(d, "a fill");
            std::fill(data, data + width, value);
            d.memory->mark_written(to + y * pitch, width * sizeof(T));
        }
        return kSuccess;
    });
}

// CUDA_MEMCPY2D. Memory types: 1 host, 2 device.
struct Copy2D {
    size_t src_x, src_y;
    unsigned src_type;
    const void* src_host;
    Address src_device;
    void* src_array;
    size_t src_pitch;
    size_t dst_x, dst_y;
    unsigned dst_type;
    void* dst_host;
    Address dst_device;
    void* dst_array;
    size_t dst_pitch;
    size_t width, height;
};

int copy_rows(Driver& d, const Copy2D& c) {
    for (size_t y = 0; y < c.height; ++y) {
        const size_t from = (c.src_y + y) * c.src_pitch + c.src_x;
        const size_t to = (c.dst_y + y) * c.dst_pitch + c.dst_x;
        const auto* host = static_cast<const uint8_t*>(c.src_host) + from;
        int result = kNotSupported;
        if (c.src_type == 1 && c.dst_type == 2) result = to_device(d, c.dst_device + to, host, c.width);
        if (c.src_type == 2 && c.dst_type == 1)
            result = to_host(d, static_cast<uint8_t*>(c.dst_host) + to, c.src_device + from, c.width);
        if (c.src_type == 2 && c.dst_type == 2) result = on_device(d, c.dst_device + to, c.src_device + from, c.width);
        if (result) return result;
    }
    return kSuccess;
}

}  // namespace

FAKE_API cuMemAlloc_v2(Address* address, size_t bytes) {
    return guarded([&](Driver& d) { return allocate(d, address, bytes); });
}
FAKE_API cuMemAllocPitch_v2(Address* address, size_t* pitch, size_t width, size_t height, unsigned) {
    return guarded(
        [&](Driver& d) { return *pitch = (width + 511) / 512 * 512, allocate(d, address, *pitch * height); });
}
FAKE_API cuMemFree_v2(Address address) {
    return guarded([&](Driver& d) {
        const int result = d.drain();
        if (result) return result;
        if (!d.memory->release(address)) return d.reject(kInvalidValue, "nothing is allocated at the address to free");
        ++d.host.frees;
        return kSuccess;
    });
}
FAKE_API cuMemGetInfo_v2(size_t* available, size_t* total) {
    return guarded([&](Driver& d) {
        *total = d.memory->capacity();
        *available = *total - d.memory->used();
        return kSuccess;
    });
}
FAKE_API cuMemGetAddressRange_v2(Address* base, size_t* bytes, Address address) {
    return guarded([&](Driver& d) {
        uint64_t start = 0;
        uint64_t size = 0;
        if (!d.memory->range_of(address, &start, &size)) return kInvalidValue;
        return *base = start, *bytes = size, kSuccess;
    });
}

FAKE_API cuMemHostAlloc(void** host, size_t bytes, unsigned) {
    return guarded([&](Driver& d) {
        if (bytes == 0) return kInvalidValue;
        *host = std::aligned_alloc(4096, (bytes + 4095) / 4096 * 4096);
        if (!*host) return kOutOfMemory;
        d.pinned[reinterpret_cast<uint64_t>(*host)] = bytes;
        return kSuccess;
    });
}
FAKE_API cuMemAllocHost_v2(void** host, size_t bytes) { return cuMemHostAlloc(host, bytes, 0); }
FAKE_API cuMemFreeHost(void* host) {
    return guarded([&](Driver& d) {
        if (!d.pinned.erase(reinterpret_cast<uint64_t>(host))) return kInvalidValue;
        const int result = d.drain();
        std::free(host);
        return result;
    });
}
FAKE_API cuMemHostRegister_v2(void* host, size_t bytes, unsigned) {
    return guarded([&](Driver& d) { return d.pinned[reinterpret_cast<uint64_t>(host)] = bytes, kSuccess; });
}
FAKE_API cuMemHostUnregister(void* host) {
    return guarded(
        [&](Driver& d) { return d.pinned.erase(reinterpret_cast<uint64_t>(host)) ? d.drain() : kInvalidValue; });
}
FAKE_API cuMemHostGetFlags(unsigned* flags, void*) { return *flags = 0, kSuccess; }

FAKE_API cuMemcpyHtoD_v2(Address to, const void* from, size_t bytes) {
    return guarded([&](Driver& d) { return after_all(d, [&] { return to_device(d, to, from, bytes); }); });
}
FAKE_API cuMemcpyDtoH_v2(void* to, Address from, size_t bytes) {
    return guarded([&](Driver& d) { return after_all(d, [&] { return to_host(d, to, from, bytes); }); });
}
FAKE_API cuMemcpyDtoD_v2(Address to, Address from, size_t bytes) {
    return guarded([&](Driver& d) { return d.submit([=, &d] { return on_device(d, to, from, bytes); }); });
}
FAKE_API cuMemcpyHtoDAsync_v2(Address to, const void* from, size_t bytes, Stream*) {
    return guarded([&](Driver& d) { return to_device_later(d, to, from, bytes); });
}
FAKE_API cuMemcpyDtoHAsync_v2(void* to, Address from, size_t bytes, Stream*) {
    return guarded([&](Driver& d) { return to_host_later(d, to, from, bytes); });
}
FAKE_API cuMemcpyDtoDAsync_v2(Address to, Address from, size_t bytes, Stream*) {
    return cuMemcpyDtoD_v2(to, from, bytes);
}
FAKE_API cuMemcpy2D_v2(const Copy2D* copy) {
    return guarded([&](Driver& d) { return after_all(d, [&] { return copy_rows(d, *copy); }); });
}
FAKE_API cuMemcpy2DUnaligned_v2(const Copy2D* copy) { return cuMemcpy2D_v2(copy); }
FAKE_API cuMemcpy2DAsync_v2(const Copy2D* copy, Stream*) {
    return guarded([&](Driver& d) {
        const Copy2D c = *copy;
        const void* host = c.src_type == 1 ? c.src_host : c.dst_host;
        const bool pageable = (c.src_type == 1 || c.dst_type == 1) && !d.is_pinned(host, 1);
        if (pageable) return after_all(d, [&] { return copy_rows(d, c); });
        return d.submit([c, &d] { return copy_rows(d, c); });
    });
}

#define FAKE_FILLS(BITS, TYPE)                                                                                      \
    FAKE_API cuMemsetD##BITS##_v2(Address to, TYPE value, size_t count) {                                           \
        return guarded([&](Driver& d) { return fill<TYPE>(d, to, 0, value, count, 1); });                           \
    }                                                                                                               \
    FAKE_API cuMemsetD##BITS##Async(Address to, TYPE value, size_t count, Stream*) {                                \
        return guarded([&](Driver& d) { return fill<TYPE>(d, to, 0, value, count, 1); });                           \
    }                                                                                                               \
    FAKE_API cuMemsetD2D##BITS##_v2(Address to, size_t pitch, TYPE value, size_t width, size_t height) {            \
        return guarded([&](Driver& d) { return fill<TYPE>(d, to, pitch, value, width, height); });                  \
    }                                                                                                               \
    FAKE_API cuMemsetD2D##BITS##Async(Address to, size_t pitch, TYPE value, size_t width, size_t height, Stream*) { \
        return guarded([&](Driver& d) { return fill<TYPE>(d, to, pitch, value, width, height); });                  \
    }
FAKE_FILLS(8, unsigned char)
FAKE_FILLS(16, unsigned short)
FAKE_FILLS(32, unsigned int)
