// Modules, functions, launches.
#include <cstdio>
#include <cstring>
#include <fstream>
#include <sstream>

#include "driver.hpp"
#include "syntax.hpp"

using namespace fake;

namespace {

constexpr uint32_t kSharedLimit = 49152;
constexpr uint32_t kSharedOptIn = 101376;

// An image is PTX if it reads like it; binaries cannot be run here.
int load(Driver& d, Module** module, const char* image) {
    if (std::strncmp(image,
                     "\x7f"
                     "ELF",
                     4) == 0 ||
        std::memcmp(image, "\x50\xed\x55\xba", 4) == 0)
        return d.reject(kNoBinary, "only PTX can be run here, not machine code");
    auto loaded = std::make_unique<Module>();
    try {
        loaded->program = parse(image, *d.memory);
    } catch (const SyntaxError& error) {
        return d.reject(kInvalidPtx, error.what());
    }
    if (loaded->program.arch > d.arch)
        return d.reject(kNoBinary, "PTX for sm_" + std::to_string(loaded->program.arch) + " on a device of sm_" +
                                       std::to_string(d.arch));
    d.modules.insert(*module = loaded.release());
    return kSuccess;
}

// CU_JIT_ERROR_LOG_BUFFER is 5, its size 6; sizes are values, not addresses.
void write_log(const Driver& d, unsigned count, const int* options, void** values) {
    char* buffer = nullptr;
    size_t size = 0;
    size_t* told = nullptr;
    for (unsigned k = 0; k < count; ++k) {
        if (options[k] == 5) buffer = static_cast<char*>(values[k]);
        if (options[k] == 6) size = reinterpret_cast<size_t>(values[k]), told = reinterpret_cast<size_t*>(&values[k]);
        if (options[k] == 4) values[k] = nullptr;
    }
    if (!buffer || !size) return;
    std::snprintf(buffer, size, "%s", d.message.c_str());
    *told = std::strlen(buffer) + 1;
}

uint32_t static_shared(const Kernel& kernel) {
    uint32_t bytes = 0;
    for (const auto& v : kernel.module->program.shared) bytes += v.bytes;
    for (const Function& f : kernel.module->program.functions)
        if (!f.kernel || &f == kernel.function)
            for (const auto& v : f.shared) bytes += v.bytes;
    return bytes;
}

int check_shape(Driver& d, const Kernel& kernel, Dim3 grid, Dim3 block, uint32_t shared) {
    if (!grid.count() || !block.count()) return d.reject(kInvalidValue, "an empty grid or block");
    if (block.x > 1024 || block.y > 1024 || block.z > 64 || block.count() > 1024 || grid.y > 65535 || grid.z > 65535)
        return d.reject(kInvalidValue, "a grid or block beyond the limits");
    if (block.count() > kernel.function->max_threads)
        return d.reject(kOutOfResources, "more threads than the kernel is bounded to");
    const uint32_t fixed = static_shared(kernel);
    if (shared > kernel.dynamic_limit || fixed + shared > std::max(kSharedLimit, kernel.dynamic_limit + fixed))
        return d.reject(kInvalidValue, "more shared memory than allowed: " + std::to_string(fixed) + " + " +
                                           std::to_string(shared) + " bytes");
    return kSuccess;
}

// Pointers that PTX marks as such must point into an allocation or be null.
int check_pointers(Driver& d, const Function& f, const std::vector<uint8_t>& params) {
    for (size_t k = 0; k < f.params.size(); ++k) {
        if (!f.params[k].pointer) continue;
        uint64_t address;
        uint64_t start;
        uint64_t bytes;
        std::memcpy(&address, &params[f.params[k].offset], sizeof address);
        if (address && !d.memory->range_of(address, &start, &bytes))
            return d.reject(kInvalidValue,
                            "argument " + std::to_string(k) + " of " + f.name + " points to no allocation");
    }
    return kSuccess;
}

// Arguments come packed in `extra`, or one by one.
int gather(Driver& d, const Function& f, void** single, void** extra, std::vector<uint8_t>* params) {
    params->assign(f.param_bytes, 0);
    if (single) {
        for (size_t k = 0; k < f.params.size(); ++k)
            std::memcpy(params->data() + f.params[k].offset, single[k], f.params[k].bytes);
        return kSuccess;
    }
    const void* buffer = nullptr;
    size_t size = 0;
    for (; extra && *extra; extra += 2) {
        if (*extra == reinterpret_cast<void*>(1)) buffer = extra[1];
        if (*extra == reinterpret_cast<void*>(2)) size = *static_cast<size_t*>(extra[1]);
    }
    if (size != f.param_bytes)
        return d.reject(kInvalidValue, f.name + " takes " + std::to_string(f.params.size()) + " arguments of " +
                                           std::to_string(f.param_bytes) + " bytes, not " + std::to_string(size));
    if (size) std::memcpy(params->data(), buffer, size);
    return kSuccess;
}

int run(Driver& d, const Kernel& kernel, Dim3 grid, Dim3 block, uint32_t shared, const std::vector<uint8_t>& params) {
    const std::string& name = kernel.function->name;
    d.look_for_faults();
    if (d.failing_launch.strikes()) return d.break_down(d.failing_launch.code, "a planned fault: kernel " + name);
    Launch launch{kernel.module->program,
                  *kernel.function,
                  grid,
                  block,
                  shared,
                  params,
                  *d.memory,
                  d.shared,
                  d.settings,
                  &d.stamp,
                  {}};
    int result = kSuccess;
    try {
        launch.run();
    } catch (const Fault& fault) {
        result = d.break_down(fault.code, fault.what());
    }
    Counters& sum = d.counters[name];
    auto* to = reinterpret_cast<uint64_t*>(&sum);
    const auto* from = reinterpret_cast<const uint64_t*>(&launch.counters);
    for (size_t k = 0; k < sizeof(Counters) / sizeof(uint64_t); ++k) to[k] += from[k];
    return result;
}

}  // namespace

FAKE_API cuModuleLoadData(Module** module, const void* image) {
    return guarded([&](Driver& d) { return load(d, module, static_cast<const char*>(image)); });
}
FAKE_API cuModuleLoadDataEx(Module** module, const void* image, unsigned count, int* options, void** values) {
    return guarded([&](Driver& d) {
        d.message.clear();
        const int result = load(d, module, static_cast<const char*>(image));
        write_log(d, count, options, values);
        return result;
    });
}
FAKE_API cuModuleLoad(Module** module, const char* path) {
    return guarded([&](Driver& d) {
        std::ifstream file(path);
        if (!file) return kFileNotFound;
        std::ostringstream text;
        text << file.rdbuf();
        return load(d, module, text.str().c_str());
    });
}
FAKE_API cuModuleUnload(Module* module) {
    return guarded([&](Driver& d) {
        const int result = d.drain();
        if (result) return result;
        if (!d.modules.erase(module)) return kInvalidHandle;
        for (const GlobalVariable& v : module->program.globals) d.memory->release(v.address);
        for (auto k = d.kernels.begin(); k != d.kernels.end();) {
            if (k->first.first != module) {
                ++k;
                continue;
            }
            d.kernel_handles.erase(k->second.get());
            k = d.kernels.erase(k);
        }
        delete module;
        return kSuccess;
    });
}
FAKE_API cuModuleGetFunction(Kernel** kernel, Module* module, const char* name) {
    return guarded([&](Driver& d) {
        if (!d.modules.count(module)) return kInvalidHandle;
        for (const Function& f : module->program.functions) {
            if (!f.kernel || f.name != name) continue;
            auto& slot = d.kernels[{module, name}];
            if (!slot) slot = std::make_unique<Kernel>(Kernel{module, &f, kSharedLimit});
            d.kernel_handles.insert(*kernel = slot.get());
            return kSuccess;
        }
        return kNotFound;
    });
}
FAKE_API cuModuleGetGlobal_v2(unsigned long long* address, size_t* bytes, Module* module, const char* name) {
    return guarded([&](Driver& d) {
        if (!d.modules.count(module)) return kInvalidHandle;
        for (const GlobalVariable& v : module->program.globals)
            if (v.name == name) {
                if (address) *address = v.address;
                if (bytes) *bytes = v.bytes;
                return kSuccess;
            }
        return kNotFound;
    });
}

// By the numbers of CUfunction_attribute.
FAKE_API cuFuncGetAttribute(int* value, int which, Kernel* kernel) {
    return guarded([&](Driver& d) {
        if (!d.kernel_handles.count(kernel)) return kInvalidHandle;
        const auto local = static_cast<int>(kernel->module->program.local_valid.size());
        const int values[] = {static_cast<int>(kernel->function->max_threads),
                              static_cast<int>(static_shared(*kernel)),
                              0,
                              local,
                              32,
                              d.arch,
                              d.arch,
                              0,
                              static_cast<int>(kernel->dynamic_limit),
                              -1};
        if (which < 0 || which > 9) return kInvalidValue;
        return *value = values[which], kSuccess;
    });
}
FAKE_API cuFuncSetAttribute(Kernel* kernel, int which, int value) {
    return guarded([&](Driver& d) {
        if (!d.kernel_handles.count(kernel)) return kInvalidHandle;
        if (which == 9) return kSuccess;
        if (which != 8 || value < 0 || static_cast<uint32_t>(value) + static_shared(*kernel) > kSharedOptIn)
            return d.reject(kInvalidValue, "a function attribute that cannot be set so");
        kernel->dynamic_limit = static_cast<uint32_t>(value);
        return kSuccess;
    });
}
FAKE_API cuFuncSetCacheConfig(Kernel*, int) { return kSuccess; }
FAKE_API cuFuncSetSharedMemConfig(Kernel*, int) { return kSuccess; }
FAKE_API cuFuncSetBlockShape(Kernel*, int, int, int) { return kSuccess; }  // PyCUDA calls it before every launch

FAKE_API cuLaunchKernel(Kernel* kernel, unsigned gx, unsigned gy, unsigned gz, unsigned bx, unsigned by, unsigned bz,
                        unsigned shared, Stream*, void** single, void** extra) {
    return guarded([&](Driver& d) {
        if (!d.kernel_handles.count(kernel)) return kInvalidHandle;
        const Dim3 grid{gx, gy, gz};
        const Dim3 block{bx, by, bz};
        std::vector<uint8_t> params;
        int result = check_shape(d, *kernel, grid, block, shared);
        if (!result) result = gather(d, *kernel->function, single, extra, &params);
        if (!result) result = check_pointers(d, *kernel->function, params);
        if (result) return result;
        return d.submit([=, &d] { return run(d, *kernel, grid, block, shared, params); });
    });
}
