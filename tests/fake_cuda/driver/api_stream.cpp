// Streams and events. All streams are one: work is done in the order in which it was handed in.
#include "driver.hpp"

using namespace fake;

namespace {

// Each question brings the device one step further.
int query(Driver& d) {
    if (d.queue.empty()) return kSuccess;
    const int result = d.work_off_one();
    if (result) return result;
    return d.queue.empty() ? kSuccess : kNotReady;
}

int record(Event* event) {
    event->time = std::chrono::steady_clock::now();
    event->done = true;
    return kSuccess;
}

int elapsed(float* milliseconds, Event* start, Event* end) {
    return guarded([&](Driver&) {
        if (!start->recorded || !end->recorded) return kInvalidHandle;
        if (!start->done || !end->done) return kNotReady;
        *milliseconds = std::chrono::duration<float, std::milli>(end->time - start->time).count();
        return kSuccess;
    });
}

}  // namespace

FAKE_API cuStreamCreate(Stream** stream, unsigned) {
    return guarded([&](Driver& d) { return d.streams.insert(*stream = new Stream), kSuccess; });
}
FAKE_API cuStreamDestroy_v2(Stream* stream) {
    return guarded([&](Driver& d) { return d.streams.erase(stream) ? (delete stream, d.drain()) : kInvalidHandle; });
}
FAKE_API cuStreamSynchronize(Stream*) {
    return guarded([](Driver& d) { return d.synchronise(); });
}
FAKE_API cuStreamQuery(Stream*) { return guarded(query); }
FAKE_API cuStreamWaitEvent(Stream*, Event*, unsigned) {
    return guarded([](Driver&) { return kSuccess; });
}

FAKE_API cuEventCreate(Event** event, unsigned) {
    return guarded([&](Driver& d) { return d.events.insert(*event = new Event), kSuccess; });
}
FAKE_API cuEventDestroy_v2(Event* event) {
    return guarded([&](Driver& d) {
        const int result = d.drain();
        if (!d.events.erase(event)) return kInvalidHandle;
        delete event;
        return result;
    });
}
FAKE_API cuEventRecord(Event* event, Stream*) {
    return guarded([&](Driver& d) {
        if (!d.events.count(event)) return kInvalidHandle;
        event->recorded = true;
        event->done = false;
        return d.submit([=] { return record(event); });
    });
}
FAKE_API cuEventSynchronize(Event*) {
    return guarded([](Driver& d) { return d.synchronise(); });
}
FAKE_API cuEventQuery(Event* event) {
    return guarded([&](Driver& d) {
        if (!d.events.count(event)) return kInvalidHandle;
        if (!event->recorded || event->done) return kSuccess;
        const int result = query(d);
        return result && result != kNotReady ? result : (event->done ? kSuccess : kNotReady);
    });
}
FAKE_API cuEventElapsedTime(float* milliseconds, Event* start, Event* end) { return elapsed(milliseconds, start, end); }
FAKE_API cuEventElapsedTime_v2(float* milliseconds, Event* start, Event* end) {
    return elapsed(milliseconds, start, end);
}

FAKE_API cuProfilerInitialize(const char*, const char*, int) { return kSuccess; }
FAKE_API cuProfilerStart() { return kSuccess; }
FAKE_API cuProfilerStop() { return kSuccess; }
