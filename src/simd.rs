//! Kernels compiled for wider vector instructions beside the plain target; which one runs is chosen when the program runs.
//!
//! All versions give the same bits: no fused multiply-add is allowed, and none depends on the order of a sum.

/// Define a function that runs another one, compiled for AVX2 and its companions where the processor has them.
///
/// The other one is a free function with `#[inline(always)]`, so that its body is compiled once for each target. In unit tests
/// [`PLAIN_ONLY`] chooses the plain version. A type parameter and its bound stand in square brackets.
macro_rules! multiversioned {
    ($(#[$meta:meta])* $vis:vis fn $name:ident $([$of:ident: $bound:path])? ($($arg:ident: $ty:ty),* $(,)?) $(-> $out:ty)?
        = $body:ident;
    ) => {
        $(#[$meta])*
        $vis fn $name $(<$of: $bound>)? ($($arg: $ty),*) $(-> $out)? {
            #[multiversion::multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt+popcnt"))]
            fn widest $(<$of: $bound>)? ($($arg: $ty),*) $(-> $out)? {
                $body($($arg),*)
            }
            #[cfg(test)]
            if $crate::simd::PLAIN_ONLY.load(std::sync::atomic::Ordering::Relaxed) {
                return $body($($arg),*);
            }
            widest($($arg),*)
        }
    };
}
pub(crate) use multiversioned;

/// Whether kernels run as they are compiled for the plain target. Tests that run meanwhile get the same results.
#[cfg(test)]
pub(crate) static PLAIN_ONLY: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(false);
