// SPDX-License-Identifier: MIT
// The one parallel loop of the host.
//
// Order: items are taken in order, finished in any order; a caller that wants the same result on any number of
// threads writes item i into place i.  Errors: the first exception ends the loop (items begun are finished, no
// further one starts) and is thrown again in the calling thread.
#pragma once
#include <functional>

namespace imucal {

// f(0) .. f(n - 1) on up to `threads` threads; the calling thread is one of them.  threads < 1 counts as 1.
void parallel_for(long n, int threads, const std::function<void(long)>& f);

// The same while the calling thread only watches: it calls `watch` about every 50 ms until the last item is
// done.  What `watch` throws ends the loop like an exception of f.
void parallel_for(long n, int threads, const std::function<void(long)>& f, const std::function<void()>& watch);

} // namespace imucal
