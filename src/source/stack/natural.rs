//! Natural order of file names: numbers in them are compared by value.

use std::cmp::Ordering;

/// Names as people count: slice2 before slice10.
pub fn natural(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a.as_bytes(), b.as_bytes());
    while let (Some(&c), Some(&d)) = (x.first(), y.first()) {
        if c.is_ascii_digit() && d.is_ascii_digit() {
            let digits = |s: &[u8]| s.iter().take_while(|c| c.is_ascii_digit()).count();
            let (n, m) = (digits(x), digits(y));
            let bare = |s: &[u8]| s.iter().skip_while(|c| **c == b'0').copied().collect::<Vec<u8>>();
            let (p, q) = (bare(&x[..n]), bare(&y[..m]));
            let order = p.len().cmp(&q.len()).then(p.cmp(&q));
            if order.is_ne() {
                return order;
            }
            (x, y) = (&x[n..], &y[m..]);
        } else if c != d {
            return c.cmp(&d);
        } else {
            (x, y) = (&x[1..], &y[1..]);
        }
    }
    x.len().cmp(&y.len()).then(a.cmp(b))
}
