// Devices, contexts, error texts.
#include <algorithm>
#include <cstdio>
#include <cstring>

#include "driver.hpp"

using namespace fake;

namespace {

// By the numbers of CUdevice_attribute; what is not here is 0.
int attribute(const Driver& d, int which) {
    static const std::map<int, int> known = {
        {1, 1024},  {2, 1024},  {3, 1024}, {4, 64},          {5, 2147483647}, {6, 65535},    {7, 65535},
        {8, 49152}, {9, 65536}, {10, 32},  {11, 2147483647}, {12, 65536},     {13, 1000000}, {14, 512},
        {15, 1},    {16, 30},   {31, 1},   {33, 1},          {36, 7000000},   {37, 256},     {38, 4194304},
        {39, 1536}, {40, 2},    {41, 1},   {81, 102400},     {82, 65536},     {97, 101376}};
    if (which == 75) return d.arch / 10;
    if (which == 76) return d.arch % 10;
    const auto found = known.find(which);
    return found == known.end() ? 0 : found->second;
}

template <class F>
int with_device(int device, F f) {
    Driver& d = driver();
    const std::lock_guard<std::recursive_mutex> lock(d.mutex);
    if (!d.initialised) return kNotInitialised;
    if (device < 0 || device >= d.devices) return kInvalidDevice;
    return f(d);
}

int create_context(Context** context, int device) {
    return with_device(device, [&](Driver& d) {
        if (d.sticky) return d.sticky;
        *context = new Context;
        d.contexts.insert(*context);
        context_stack().push_back(*context);
        return kSuccess;
    });
}

int destroy_context(Context* context) {
    Driver& d = driver();
    if (!d.contexts.erase(context)) return kInvalidContext;
    auto& stack = context_stack();
    stack.erase(std::remove(stack.begin(), stack.end(), context), stack.end());
    delete context;
    return kSuccess;
}

bool is_context(Driver& d, Context* context) { return context == &d.primary || d.contexts.count(context); }

const char* error_text(int code) {
    static const std::map<int, const char*> texts = {
        {kSuccess, "no error"},
        {kInvalidValue, "invalid argument"},
        {kOutOfMemory, "out of memory"},
        {kNotInitialised, "initialization error"},
        {kNoDevice, "no CUDA-capable device is detected"},
        {kInvalidDevice, "invalid device ordinal"},
        {kInvalidContext, "invalid device context"},
        {kNoBinary, "no kernel image is available for execution on the device"},
        {214, "uncorrectable ECC error encountered"},
        {kInvalidPtx, "a PTX JIT compilation failed"},
        {220, "uncorrectable NVLink error detected during the execution"},
        {226, "Invalid access of peer GPU memory over nvlink or a hardware error"},
        {kFileNotFound, "file not found"},
        {kInvalidHandle, "invalid resource handle"},
        {kNotFound, "named symbol not found"},
        {kNotReady, "device not ready"},
        {kIllegalAddress, "an illegal memory access was encountered"},
        {kOutOfResources, "too many resources requested for launch"},
        {kTimeout, "the launch timed out and was terminated"},
        {709, "context is destroyed"},
        {kAssert, "device-side assert triggered"},
        {714, "hardware stack error"},
        {715, "an illegal instruction was encountered"},
        {kMisaligned, "misaligned address"},
        {717, "operation not supported on global/shared address space"},
        {718, "invalid program counter"},
        {kLaunchFailed, "unspecified launch failure"},
        {721, "tensor memory not completely freed"},
        {kNotSupported, "operation not supported"},
        {999, "unknown error"}};
    const auto found = texts.find(code);
    return found == texts.end() ? "unknown error" : found->second;
}

}  // namespace

FAKE_API cuInit(unsigned) {
    Driver& d = driver();
    if (d.devices == 0) return kNoDevice;
    d.initialised = true;
    return kSuccess;
}
FAKE_API cuDriverGetVersion(int* version) { return *version = 13000, kSuccess; }
// NVRTC asks for tables that no document names, and does without them.
FAKE_API cuGetExportTable(const void** table, const void*) { return *table = nullptr, kNotFound; }
FAKE_API cuDeviceGetCount(int* count) {
    return *count = driver().devices, driver().initialised ? kSuccess : kNotInitialised;
}
FAKE_API cuDeviceGet(int* device, int ordinal) {
    return with_device(ordinal, [&](Driver&) { return *device = ordinal, kSuccess; });
}
FAKE_API cuDeviceGetName(char* name, int size, int device) {
    return with_device(
        device, [&](Driver&) { return std::snprintf(name, static_cast<size_t>(size), "Fake CUDA device"), kSuccess; });
}
FAKE_API cuDeviceGetAttribute(int* value, int which, int device) {
    return with_device(device, [&](Driver& d) { return *value = attribute(d, which), kSuccess; });
}
FAKE_API cuDeviceComputeCapability(int* major, int* minor, int device) {
    return with_device(device, [&](Driver& d) { return *major = d.arch / 10, *minor = d.arch % 10, kSuccess; });
}
FAKE_API cuDeviceTotalMem_v2(size_t* bytes, int device) {
    return with_device(device, [&](Driver& d) { return *bytes = d.memory->capacity(), kSuccess; });
}
FAKE_API cuDeviceGetPCIBusId(char* id, int size, int device) {
    return with_device(device,
                       [&](Driver&) { return std::snprintf(id, static_cast<size_t>(size), "0000:01:00.0"), kSuccess; });
}
FAKE_API cuDeviceGetByPCIBusId(int* device, const char* id) {
    return std::strcmp(id, "0000:01:00.0") == 0 ? (*device = 0, kSuccess) : kInvalidDevice;
}
FAKE_API cuDeviceCanAccessPeer(int* can, int, int) { return *can = 0, kSuccess; }

FAKE_API cuCtxCreate_v2(Context** context, unsigned, int device) { return create_context(context, device); }
FAKE_API cuCtxCreate_v3(Context** context, void*, int, unsigned, int device) { return create_context(context, device); }
FAKE_API cuCtxCreate_v4(Context** context, void*, unsigned, int device) { return create_context(context, device); }
FAKE_API cuCtxDestroy_v2(Context* context) { return destroy_context(context); }
FAKE_API cuCtxDetach(Context* context) { return destroy_context(context); }
FAKE_API cuCtxAttach(Context** context, unsigned) {
    return guarded([&](Driver&) { return *context = context_stack().back(), kSuccess; });
}
FAKE_API cuCtxGetCurrent(Context** context) {
    *context = context_stack().empty() ? nullptr : context_stack().back();
    return kSuccess;
}
FAKE_API cuCtxSetCurrent(Context* context) {
    auto& stack = context_stack();
    if (!stack.empty()) stack.pop_back();
    if (context) stack.push_back(context);
    return kSuccess;
}
FAKE_API cuCtxPushCurrent_v2(Context* context) {
    if (!is_context(driver(), context)) return kInvalidContext;
    context_stack().push_back(context);
    return kSuccess;
}
FAKE_API cuCtxPopCurrent_v2(Context** context) {
    auto& stack = context_stack();
    if (stack.empty()) return kInvalidContext;
    *context = stack.back();
    stack.pop_back();
    return kSuccess;
}
FAKE_API cuCtxGetDevice(int* device) { return context_stack().empty() ? kInvalidContext : (*device = 0, kSuccess); }
FAKE_API cuCtxGetApiVersion(Context*, unsigned* version) { return *version = 13000, kSuccess; }
FAKE_API cuCtxGetCacheConfig(int* config) { return *config = 0, kSuccess; }
FAKE_API cuCtxSetCacheConfig(int) { return kSuccess; }
FAKE_API cuCtxGetSharedMemConfig(int* config) { return *config = 1, kSuccess; }
FAKE_API cuCtxSetSharedMemConfig(int) { return kSuccess; }
FAKE_API cuCtxGetLimit(size_t* value, int) { return *value = 1024, kSuccess; }
FAKE_API cuCtxSetLimit(int, size_t) { return kSuccess; }
FAKE_API cuCtxSynchronize() {
    return guarded([](Driver& d) { return d.synchronise(); });
}
FAKE_API cuDevicePrimaryCtxRetain(Context** context, int device) {
    return with_device(device, [&](Driver& d) { return ++d.primary.users, *context = &d.primary, kSuccess; });
}
FAKE_API cuDevicePrimaryCtxRelease_v2(int device) {
    return with_device(device,
                       [&](Driver& d) { return d.primary.users ? (--d.primary.users, kSuccess) : kInvalidContext; });
}
FAKE_API cuDevicePrimaryCtxRelease(int device) { return cuDevicePrimaryCtxRelease_v2(device); }

// After a breakdown the text says what happened: it is what the tests read.
FAKE_API cuGetErrorString(int code, const char** text) {
    static thread_local std::string told;
    Driver& d = driver();
    told = error_text(code);
    if (code && !d.message.empty() &&
        (code == d.sticky || code == kInvalidPtx || code == kInvalidValue || code == kNoBinary))
        told += " (" + d.message + ")";
    *text = told.c_str();
    return kSuccess;
}
FAKE_API cuGetErrorName(int code, const char** text) { return *text = error_text(code), kSuccess; }
