//! Parallel loops under the same names with and without the `parallel` feature, so that algorithms hold no `cfg`.
//! Results always come in index order, whatever the thread count.

#[cfg(feature = "parallel")]
use std::{
    collections::BTreeMap,
    sync::{Mutex, MutexGuard, PoisonError},
};

/// Run `f(i)` for every `i` below `n`, spread over the current pool. Its closure is a `dyn`, so that rayon's machinery is
/// compiled once, and not again for each of the thirty loops that are made of this one.
#[cfg(feature = "parallel")]
fn each(n: usize, f: &(dyn Fn(usize) + Sync)) {
    use rayon::prelude::*;
    (0..n).into_par_iter().with_max_len(1).for_each(f);
}

#[cfg(feature = "parallel")]
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// `(0..n).map(f)`, spread over the current pool.
#[cfg(feature = "parallel")]
pub fn map<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    let made: Vec<Mutex<Option<T>>> = (0..n).map(|_| Mutex::new(None)).collect();
    each(n, &|i| {
        let value = f(i);
        *lock(&made[i]) = Some(value);
    });
    made.into_iter().filter_map(|slot| slot.into_inner().unwrap_or_else(PoisonError::into_inner)).collect()
}

/// `(0..n).map(f)`, serially.
#[cfg(not(feature = "parallel"))]
pub fn map<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    (0..n).map(f).collect()
}

/// `take(i, make(i))` for every `i` below `n`: `make` spread over the current pool, `take` in order, by one thread at a time while
/// the others go on. At most `ahead` results wait to be taken. Ends with the first error.
#[cfg(feature = "parallel")]
pub fn in_order<T: Send, E: Send>(
    n: usize,
    ahead: usize,
    make: impl Fn(usize) -> T + Sync,
    take: impl FnMut(usize, T) -> Result<(), E> + Send,
) -> Result<(), E> {
    let queue = Queue { next: 0, made: BTreeMap::new(), take: Some(take), result: Ok(()) };
    let all = InOrder { n, ahead: ahead.max(1), make, queue: Mutex::new(queue) };
    let shared = &all;
    rayon::in_place_scope_fifo(|scope| {
        for i in 0..n.min(shared.ahead) {
            scope.spawn_fifo(move |scope| shared.run(scope, i));
        }
    });
    all.queue.into_inner().unwrap_or_else(PoisonError::into_inner).result
}

/// What [`in_order`] shares between threads.
#[cfg(feature = "parallel")]
struct InOrder<T, M, F, E> {
    n: usize,
    ahead: usize,
    make: M,
    queue: Mutex<Queue<T, F, E>>,
}

#[cfg(feature = "parallel")]
struct Queue<T, F, E> {
    /// What is to be taken next, and what is made of it and of those after it.
    next: usize,
    made: BTreeMap<usize, T>,
    /// Away while a thread takes, and for good after an error.
    take: Option<F>,
    result: Result<(), E>,
}

#[cfg(feature = "parallel")]
impl<T: Send, M: Fn(usize) -> T + Sync, F: FnMut(usize, T) -> Result<(), E> + Send, E: Send> InOrder<T, M, F, E> {
    /// Make `i`, then take what comes next for as long as it is there; each that is taken makes room for another.
    fn run<'s>(&'s self, scope: &rayon::ScopeFifo<'s>, i: usize) {
        if lock(&self.queue).result.is_err() {
            return;
        }
        let made = (self.make)(i);
        let mut queue = lock(&self.queue);
        queue.made.insert(i, made);
        loop {
            let next = queue.next;
            if !queue.made.contains_key(&next) {
                return;
            }
            // Whoever takes now looks again once that is done.
            let Some(mut take) = queue.take.take() else { return };
            let Some(value) = queue.made.remove(&next) else { return };
            drop(queue);
            let result = take(next, value);
            queue = lock(&self.queue);
            if result.is_err() {
                queue.result = result;
                queue.made.clear();
                return;
            }
            (queue.take, queue.next) = (Some(take), next + 1);
            let more = next + self.ahead;
            if more < self.n {
                scope.spawn_fifo(move |scope| self.run(scope, more));
            }
        }
    }
}

/// `take(i, make(i))` for every `i` below `n`, serially; ends with the first error.
#[cfg(not(feature = "parallel"))]
pub fn in_order<T: Send, E: Send>(
    n: usize,
    _ahead: usize,
    make: impl Fn(usize) -> T + Sync,
    mut take: impl FnMut(usize, T) -> Result<(), E> + Send,
) -> Result<(), E> {
    (0..n).try_for_each(|i| take(i, make(i)))
}

/// Run `f(chunk index, chunk)` over `data` cut into chunks of `len`.
#[cfg(feature = "parallel")]
pub fn chunks_mut<T: Send>(data: &mut [T], len: usize, f: impl Fn(usize, &mut [T]) + Sync + Send) {
    let chunks: Vec<Mutex<&mut [T]>> = data.chunks_mut(len.max(1)).map(Mutex::new).collect();
    each(chunks.len(), &|i| f(i, &mut lock(&chunks[i])));
}

/// Run `f(chunk index, chunk)` over `data` cut into chunks of `len`.
#[cfg(not(feature = "parallel"))]
pub fn chunks_mut<T: Send>(data: &mut [T], len: usize, f: impl Fn(usize, &mut [T]) + Sync + Send) {
    data.chunks_mut(len.max(1)).enumerate().for_each(|(i, chunk)| f(i, chunk));
}

/// More threads than these gain nothing on any machine, and each takes memory.
#[cfg(feature = "parallel")]
const MAX_THREADS: usize = 256;

/// Run `f` with at most `threads` threads (at most 256) for every loop of this module inside it; 0: those that are there, which
/// is one per core unless the caller runs in a pool of its own.
///
/// A program that calls this again and again should say 0: each pool that rayon ends leaves some 2 kB per thread behind, in what
/// its queues have yet to free.
#[cfg(feature = "parallel")]
pub fn with_threads<T: Send>(threads: usize, f: impl FnOnce() -> T + Send) -> crate::Result<T> {
    if threads == 0 && rayon::current_num_threads() <= MAX_THREADS {
        return Ok(f());
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.min(MAX_THREADS))
        .build()
        .map_err(|e| crate::Error::Options(format!("option `threads` = {threads}: cannot start the threads: {e}")))?;
    Ok(pool.install(f))
}

/// Run `f` on the calling thread; `threads` has no effect in a build without `parallel`.
#[cfg(not(feature = "parallel"))]
pub fn with_threads<T: Send>(_threads: usize, f: impl FnOnce() -> T + Send) -> crate::Result<T> {
    Ok(f())
}

/// Number of threads that the loops of this module use here.
pub fn threads() -> usize {
    #[cfg(feature = "parallel")]
    return rayon::current_num_threads();
    #[cfg(not(feature = "parallel"))]
    return 1;
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

    #[test]
    fn threads_are_capped() {
        assert!(with_threads(usize::MAX, threads).unwrap() <= 256);
    }

    #[test]
    fn what_is_made_is_taken_in_order() {
        for (threads, ahead) in [(1, 1), (1, 4), (3, 1), (3, 7), (4, 1000)] {
            let made = AtomicUsize::new(0);
            let (mut all, mut farthest) = (Vec::new(), 0);
            let run = || {
                in_order(
                    200,
                    ahead,
                    |i| {
                        made.fetch_max(i + 1, SeqCst);
                        std::thread::sleep(std::time::Duration::from_micros((i * 37 % 11) as u64 * 20));
                        i * i
                    },
                    |i, value| {
                        farthest = farthest.max(made.load(SeqCst) - i);
                        all.push(value);
                        if i == 150 { Err(i) } else { Ok(()) }
                    },
                )
            };
            assert_eq!(with_threads(threads, run).unwrap(), Err(150), "the first error ends it");
            assert_eq!(all, (0..151).map(|i| i * i).collect::<Vec<_>>());
            assert!(farthest <= ahead, "{farthest} of {ahead} were made before the first of them was taken");
        }
        assert_eq!(in_order(0, 4, |i| i, |_, _| Err(())), Ok(()));
    }
}
