//! Parallel loops under the same names with and without the `parallel` feature, so that algorithms hold no `cfg`.
//! Results always come in index order, whatever the thread count.

/// `(0..n).map(f)`, spread over the current pool.
#[cfg(feature = "parallel")]
pub fn map<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    use rayon::prelude::*;
    (0..n).into_par_iter().with_max_len(1).map(f).collect()
}

/// `(0..n).map(f)`, serially.
#[cfg(not(feature = "parallel"))]
pub fn map<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    (0..n).map(f).collect()
}

/// Run `f(chunk index, chunk)` over `data` cut into chunks of `len`.
#[cfg(feature = "parallel")]
pub fn chunks_mut<T: Send>(data: &mut [T], len: usize, f: impl Fn(usize, &mut [T]) + Sync + Send) {
    use rayon::prelude::*;
    data.par_chunks_mut(len.max(1)).with_max_len(1).enumerate().for_each(|(i, chunk)| f(i, chunk));
}

/// Run `f(chunk index, chunk)` over `data` cut into chunks of `len`.
#[cfg(not(feature = "parallel"))]
pub fn chunks_mut<T: Send>(data: &mut [T], len: usize, f: impl Fn(usize, &mut [T]) + Sync + Send) {
    data.chunks_mut(len.max(1)).enumerate().for_each(|(i, chunk)| f(i, chunk));
}

/// Run `f` with at most `threads` threads (0: all cores) for every loop of this module inside it.
#[cfg(feature = "parallel")]
pub fn with_threads<T: Send>(threads: usize, f: impl FnOnce() -> T + Send) -> crate::Result<T> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| crate::Error::Options(format!("--threads {threads}: cannot start the threads: {e}")))?;
    Ok(pool.install(f))
}

/// Run `f` on the calling thread; `threads` has no effect in a build without `parallel`.
#[cfg(not(feature = "parallel"))]
pub fn with_threads<T: Send>(_threads: usize, f: impl FnOnce() -> T + Send) -> crate::Result<T> {
    Ok(f())
}

/// How many threads the loops of this module use here.
pub fn threads() -> usize {
    #[cfg(feature = "parallel")]
    return rayon::current_num_threads();
    #[cfg(not(feature = "parallel"))]
    return 1;
}
