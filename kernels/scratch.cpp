// Arrays beyond a budget lie in a scratch file instead of the heap, so that the memory of a long run is bounded.
//
// numpy takes the memory of arrays from a handler (NEP 49), here one that gives what numpy's own gives until large
// arrays hold `budget` bytes, and from then on places in a file that is mapped into memory. The kernel writes its pages
// and reads them again as they are needed. A thread watches what the process holds in memory, and where that comes
// near the limit, lets go of the heap's free pages, which malloc keeps, and of the file's pages: what is in these stays
// in the file. Values do not depend on any of this.
//
// The kernel clears each page of a file before its first use, which is dear, so the file must not grow while gaps are
// left in it. An array that no gap holds is mapped piece by piece, from several gaps, at addresses that follow.
#include "arrays.h"

#if defined(__linux__)
#include <fcntl.h>
#include <malloc.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <condition_variable>
#include <map>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace {

// numpy's handler of version 1, and where its table of functions has those that get and set it (numpy/ndarraytypes.h
// and numpy/__multiarray_api.h; the numbers belong to numpy's binary interface and do not change).
struct Handler {
    char name[127];
    std::uint8_t version;
    void *context;
    void *(*take)(void *, std::size_t);
    void *(*take_zeros)(void *, std::size_t, std::size_t);
    void *(*resize)(void *, void *, std::size_t);
    void (*give)(void *, void *, std::size_t);
};
constexpr char HANDLER_NAME[] = "mem_handler";
constexpr char NUMPYS_OWN[] = "default_allocator";  // numpy's own handler, whose memory is malloc's
constexpr int SET_HANDLER = 304, GET_HANDLER = 305;

constexpr std::size_t LARGE = std::size_t{1} << 21;      // bytes of an array that may lie in the file: a large page
constexpr std::size_t BLOCK = std::size_t{1} << 24;      // bytes that no array of one block of a long run has: 16 MiB
constexpr std::size_t RESERVED = std::size_t{1} << 38;   // addresses for the file, and for pieces, bytes: 256 GiB
constexpr std::size_t GROWTH = std::size_t{64} << 20;    // bytes that the file grows by at least
constexpr std::size_t PAGE = std::size_t{1} << 21;       // places begin at multiples of this: of all sizes of pages
constexpr std::size_t FASTEST = 100'000;                 // bytes that a process faults in within 1 us: 2 MiB in 20
constexpr auto LEAST_PAUSE = std::chrono::microseconds(1000);  // waking as often takes 2.6 % of a core

struct Range {
    std::size_t begin, length;
};

// Ranges of whole pages that are free, by where they begin.
class Gaps {
  public:
    void add(std::size_t begin, std::size_t length) {
        total_ += length;
        auto next = lengths_.lower_bound(begin);
        if (next != lengths_.end() && begin + length == next->first) {
            length += next->second;
            next = lengths_.erase(next);
        }
        if (next != lengths_.begin() && std::prev(next)->first + std::prev(next)->second == begin)
            std::prev(next)->second += length;
        else
            lengths_[begin] = length;
    }

    // Take the first gap of that length, or the beginning of it; false where there is none.
    bool take(std::size_t length, std::size_t &begin) {
        auto gap = lengths_.begin();
        while (gap != lengths_.end() && gap->second < length) ++gap;
        if (gap == lengths_.end()) return false;
        begin = gap->first;
        take_of(gap, length);
        return true;
    }

    // Take the first gap, or the beginning of it where it is longer than that.
    Range take_first(std::size_t length) {
        const auto gap = lengths_.begin();
        const Range range{gap->first, std::min(gap->second, length)};
        take_of(gap, range.length);
        return range;
    }

    std::size_t total() const { return total_; }

  private:
    void take_of(std::map<std::size_t, std::size_t>::iterator gap, std::size_t length) {
        const auto [begin, free] = *gap;
        lengths_.erase(gap);
        if (free > length) lengths_[begin + length] = free - length;
        total_ -= length;
    }

    std::map<std::size_t, std::size_t> lengths_;
    std::size_t total_ = 0;
};

// Places in a file that is mapped as a whole, and behind it in pieces. What they hold stays there when its pages are let
// go of.
class ScratchFile {
  public:
    ScratchFile(int file, std::size_t limit) : file_(file), limit_(limit), of_others_(held_now().of_files) {}

    ~ScratchFile() {
        if (watch_.joinable()) {
            {
                const std::lock_guard<std::mutex> lock(mutex_);
                ended_ = true;
            }
            wake_.notify_all();
            watch_.join();
        }
        if (base_ != nullptr) munmap(reserved_, 2 * RESERVED + PAGE);
        close(file_);
        close(statm_);
    }

    // Whether this is a copy that a forked process has. It has neither the mapping nor the thread that watches.
    bool forked() const { return getpid() != process_; }

    bool holds(const void *place) const {
        const char *base = base_.load(), *at = static_cast<const char *>(place);
        if (base == nullptr || at < base || at >= base + 2 * RESERVED) return false;
        return !forked() || places_.count(at - base) != 0;  // a forked process may use these addresses otherwise
    }

    // A place of so many bytes, in the first gap that is long enough or in pieces; null where the file cannot grow.
    void *take(std::size_t bytes) {
        if (forked()) return nullptr;
        const std::size_t length = (bytes + PAGE - 1) / PAGE * PAGE;
        const std::lock_guard<std::mutex> lock(mutex_);
        let_go(held_now());
        if (base_ == nullptr && !reserve()) return nullptr;
        std::size_t begin = 0;
        if (gaps_.take(length, begin)) {
            places_[begin] = {{begin, length}};
            return base_ + begin;
        }
        if (gaps_.total() < length && !grow(length - gaps_.total())) return nullptr;
        if (!gaps_.take(length, begin)) return take_in_pieces(length);
        places_[begin] = {{begin, length}};
        return base_ + begin;
    }

    std::size_t length(const void *place) {
        const std::lock_guard<std::mutex> lock(mutex_);
        return length_of(places_.at(static_cast<const char *>(place) - base_));
    }

    void give(void *place) {
        if (forked()) return;
        const std::lock_guard<std::mutex> lock(mutex_);
        const auto own = places_.find(static_cast<char *>(place) - base_);
        give_pieces(own->first, own->second);
        places_.erase(own);
    }

  private:
    struct Held {
        std::size_t heap, of_files;
    };

    using Pieces = std::vector<Range>;  // of the file, one after the other

    static std::size_t length_of(const Pieces &pieces) {
        std::size_t length = 0;
        for (const Range &piece : pieces) length += piece.length;
        return length;
    }

    void give_pieces(std::size_t begin, const Pieces &pieces) {
        for (const Range &piece : pieces) gaps_.add(piece.begin, piece.length);
        if (begin < RESERVED) return;
        const std::size_t length = length_of(pieces);
        map(base_ + begin, length, -1, 0);
        windows_.add(begin, length);
    }

    // Map gaps side by side, behind the whole file. Their pages at their own addresses are let go of: a page counts to
    // what the process holds wherever it is mapped.
    void *take_in_pieces(std::size_t length) {
        std::size_t begin = 0;
        if (!windows_.take(length, begin)) return nullptr;
        Pieces pieces;
        bool mapped = true;
        for (std::size_t done = 0; done < length; done += pieces.back().length) {
            pieces.push_back(gaps_.take_first(length - done));
            const Range &piece = pieces.back();
            madvise(base_ + piece.begin, piece.length, MADV_DONTNEED);
            mapped = mapped && map(base_ + begin + done, piece.length, file_, piece.begin);
        }
        if (!mapped) {  // no more mappings are allowed
            give_pieces(begin, pieces);
            return nullptr;
        }
        places_[begin] = std::move(pieces);
        return base_ + begin;
    }

    // Map a range of the file at an address, or nothing there without a file.
    static bool map(char *at, std::size_t length, int file, std::size_t begin) {
        const int what = file < 0 ? MAP_PRIVATE | MAP_ANONYMOUS : MAP_SHARED;
        const int access = file < 0 ? PROT_NONE : PROT_READ | PROT_WRITE;
        if (mmap(at, length, access, what | MAP_FIXED | MAP_NORESERVE, file, begin) == MAP_FAILED) return false;
        madvise(at, length, MADV_DONTFORK);  // a child process would write into its parent's arrays
        madvise(at, length, MADV_HUGEPAGE);  // one page fault every 2 MiB where the file system has such pages
        return true;
    }

    // Reserve addresses, map the file, which is empty, and begin to watch.
    bool reserve() {
        void *reserved = mmap(nullptr, 2 * RESERVED + PAGE, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        if (reserved == MAP_FAILED) return false;
        char *base = static_cast<char *>(reserved);
        base += (PAGE - reinterpret_cast<std::uintptr_t>(base) % PAGE) % PAGE;
        if (!map(base, RESERVED, file_, 0)) {
            munmap(reserved, 2 * RESERVED + PAGE);
            return false;
        }
        reserved_ = reserved;
        windows_.add(RESERVED, RESERVED);
        base_ = base;
        try {
            watch_ = std::thread(&ScratchFile::watch, this);
        } catch (const std::system_error &) {  // no more threads are allowed: take() lets go of pages alone
        }
        return true;
    }

    // Make the gaps longer by that. The file's blocks are allocated: a disk that is full is noticed here.
    bool grow(std::size_t length) {
        const std::size_t more = std::max(length, GROWTH);
        if (size_ + more > RESERVED || posix_fallocate(file_, size_, more) != 0) return false;
        gaps_.add(size_, more);
        size_ += more;
        return true;
    }

    // Look at what the process holds, and four times again before it can reach the limit: this thread may wake late.
    void watch() {
        std::unique_lock<std::mutex> lock(mutex_);
        auto pause = LEAST_PAUSE;
        while (!wake_.wait_for(lock, pause, [this] { return ended_; })) {
            trim_heap(held_now());
            const Held held = held_now();
            let_go(held);
            const std::size_t left = limit_ - std::min(limit_, held.heap + held.of_files);
            pause = std::max(LEAST_PAUSE, std::chrono::microseconds(left / FASTEST / 4));
        }
    }

    // Let go of the heap's free pages where the process holds much, and its heap has grown.
    void trim_heap(const Held &held) {
#if defined(__GLIBC__)
        if (held.heap + held.of_files < limit_ / 10 * 8 || held.heap <= trimmed_ + limit_ / 10) return;
        malloc_trim(0);
        trimmed_ = held_now().heap;
#endif
    }

    // Let go of the file's pages where the process holds much, and enough of it is the file's.
    void let_go(const Held &held) {
        if (held.heap + held.of_files < limit_ / 10 * 8 || held.of_files < of_others_ + limit_ / 20) return;
        madvise(base_, size_, MADV_DONTNEED);
        for (const auto &[begin, pieces] : places_)
            if (begin >= RESERVED) madvise(base_ + begin, length_of(pieces), MADV_DONTNEED);
        // Other threads map the file's pages again meanwhile, so that what is left is not all others'.
        of_others_ = std::min(held_now().of_files, of_others_ + limit_ / 100);
    }

    // Bytes that the process holds in memory: those of files, and all others.
    Held held_now() const {
        char text[128] = {};
        unsigned long all = 0, resident = 0, of_files = 0;
        if (pread(statm_, text, sizeof text - 1, 0) <= 0) return {};
        if (std::sscanf(text, "%lu %lu %lu", &all, &resident, &of_files) != 3) return {};
        return {(resident - of_files) * page_, of_files * page_};
    }

    const int file_;
    const std::size_t limit_;
    const pid_t process_ = getpid();
    const int statm_ = open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
    const std::size_t page_ = sysconf(_SC_PAGESIZE);
    void *reserved_ = nullptr;
    std::atomic<char *> base_{nullptr};
    std::size_t size_ = 0;
    std::size_t of_others_;  // bytes of other files in memory, as those of libraries
    std::size_t trimmed_ = 0;  // bytes of the heap in memory after its free pages were let go of
    Gaps gaps_, windows_;  // of the file, and of the addresses behind it
    std::map<std::size_t, Pieces> places_;
    std::mutex mutex_;
    std::condition_variable wake_;
    std::thread watch_;
    bool ended_ = false;
};

struct Scratch {
    Handler handler;
    const Handler *heap;  // gives what is not in the file
    PyObject *heap_owner;
    std::size_t budget;
    std::atomic<std::size_t> on_heap{0};  // bytes of large arrays
    ScratchFile file;

    Scratch(const Handler *before, PyObject *owner, int descriptor, std::size_t budget_, std::size_t limit);

    void *counted(void *place) {
        const std::size_t bytes = place == nullptr ? 0 : malloc_usable_size(place);
        if (bytes >= LARGE) on_heap += bytes;
        return place;
    }
    void discount(void *place) {
        const std::size_t bytes = malloc_usable_size(place);
        if (bytes >= LARGE) on_heap -= bytes;
    }
    // A place in the file for an array that is large and beyond the budget; null for all others. A quarter of the budget
    // is for arrays of blocks: their memory is used again and again, and the kernel writes none of it to a disk.
    void *spilled(std::size_t bytes) {
        const std::size_t share = bytes < BLOCK ? budget : budget / 4 * 3;
        return bytes < LARGE || on_heap + bytes <= share ? nullptr : file.take(bytes);
    }
};

void *take(void *context, std::size_t bytes) {
    Scratch &own = *static_cast<Scratch *>(context);
    if (void *place = own.spilled(bytes)) return place;
    return own.counted(own.heap->take(own.heap->context, bytes));
}

void *take_zeros(void *context, std::size_t count, std::size_t size) {
    Scratch &own = *static_cast<Scratch *>(context);
    if (void *place = own.spilled(count * size)) return std::memset(place, 0, count * size);
    return own.counted(own.heap->take_zeros(own.heap->context, count, size));
}

void give(void *context, void *place, std::size_t bytes) {
    Scratch &own = *static_cast<Scratch *>(context);
    if (place == nullptr) return;
    if (own.file.holds(place)) return own.file.give(place);
    own.discount(place);
    own.heap->give(own.heap->context, place, bytes);
}

void *resize(void *context, void *place, std::size_t bytes) {
    Scratch &own = *static_cast<Scratch *>(context);
    if (place == nullptr) return take(context, bytes);
    if (!own.file.holds(place)) {
        own.discount(place);
        void *moved = own.heap->resize(own.heap->context, place, bytes);
        own.counted(moved == nullptr ? place : moved);
        return moved;
    }
    void *moved = take(context, bytes);
    if (moved == nullptr) return nullptr;
    const std::size_t length = own.file.length(place);
    std::memcpy(moved, place, length < bytes ? length : bytes);
    own.file.give(place);
    return moved;
}

Scratch::Scratch(const Handler *before, PyObject *owner, int descriptor, std::size_t budget_, std::size_t limit)
    : handler{"trackfg_scratch", 1, this, ::take, ::take_zeros, ::resize, ::give},
      heap(before),
      heap_owner(owner),
      budget(budget_),
      file(descriptor, limit) {}

// Every array has a reference to the handler of its memory: with the last of them the file goes.
void end(PyObject *capsule) {
    auto *own = static_cast<Scratch *>(static_cast<Handler *>(PyCapsule_GetPointer(capsule, HANDLER_NAME))->context);
    if (own->file.forked()) return;  // waits for a thread that is not there
    PyObject *owner = own->heap_owner;
    delete own;
    Py_DECREF(owner);
}

// Return the handler before, which this context's arrays are from no longer.
PyObject *set_handler(void **table, PyObject *handler) {
    return reinterpret_cast<PyObject *(*)(PyObject *)>(table[SET_HANDLER])(handler);
}

}  // namespace

// spill(table, file, budget, limit) -> handler: from now on this context's arrays beyond `budget` bytes of large ones
// lie in the file (a descriptor, which is duplicated), and of that no more in memory than the process's `limit` allows.
// `table` is numpy's _ARRAY_API; returned is the handler before, for unspill(table, handler). Where that is not numpy's
// own, nothing happens and None is returned: the length of what another handler gave cannot be asked for.
PyObject *spill(PyObject *, PyObject *arguments) {
    PyObject *py_table;
    int file;
    Py_ssize_t budget, limit;
    if (!PyArg_ParseTuple(arguments, "Oinn", &py_table, &file, &budget, &limit)) return nullptr;
    if (budget < 0 || limit < 0) {
        PyErr_SetString(PyExc_ValueError, "expected a budget and a limit of 0 bytes or more");
        return nullptr;
    }
    void **table = static_cast<void **>(PyCapsule_GetPointer(py_table, nullptr));
    if (table == nullptr) return nullptr;
    PyObject *before = reinterpret_cast<PyObject *(*)()>(table[GET_HANDLER])();
    if (before == nullptr) return nullptr;
    const auto *heap = static_cast<const Handler *>(PyCapsule_GetPointer(before, HANDLER_NAME));
    if (heap == nullptr || std::strcmp(heap->name, NUMPYS_OWN) != 0) {
        Py_DECREF(before);
        if (heap == nullptr) return nullptr;
        Py_RETURN_NONE;
    }
    const int own_file = fcntl(file, F_DUPFD_CLOEXEC, 0);
    if (own_file < 0) {
        Py_DECREF(before);
        return PyErr_SetFromErrno(PyExc_OSError);
    }
    auto *scratch = new Scratch(heap, before, own_file, budget, limit);
    PyObject *capsule = PyCapsule_New(&scratch->handler, HANDLER_NAME, end);
    if (capsule == nullptr) {
        delete scratch;
        Py_DECREF(before);
        return nullptr;
    }
    PyObject *replaced = set_handler(table, capsule);
    Py_DECREF(capsule);
    return replaced;
}

// unspill(table, handler): arrays are from `handler` again; those in the file stay there until they go.
PyObject *unspill(PyObject *, PyObject *arguments) {
    PyObject *py_table, *handler;
    if (!PyArg_ParseTuple(arguments, "OO", &py_table, &handler)) return nullptr;
    void **table = static_cast<void **>(PyCapsule_GetPointer(py_table, nullptr));
    if (table == nullptr) return nullptr;
    PyObject *replaced = set_handler(table, handler);
    Py_XDECREF(replaced);
    if (replaced == nullptr) return nullptr;
    Py_RETURN_NONE;
}

#else

PyObject *spill(PyObject *, PyObject *) {
    PyErr_SetString(PyExc_NotImplementedError, "arrays lie in a file under Linux alone");
    return nullptr;
}

PyObject *unspill(PyObject *, PyObject *) { return spill(nullptr, nullptr); }

#endif
