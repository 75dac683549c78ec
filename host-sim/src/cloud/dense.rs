//! The coupled step by a dense Cholesky factor, which follows a changing cloud by rank-one updates (CB §4.4–4.5).

use super::wide::{Simd, Wide, wide};

/// `L·Lᵀ`, L lower and kept column after column.
#[derive(Clone)]
pub struct Cholesky {
    n: usize,
    /// Column j is `columns[j]`, its first entry on the diagonal.
    columns: Vec<Vec<f64>>,
}

impl Cholesky {
    /// Of no rows yet.
    pub fn empty() -> Self {
        Self {
            n: 0,
            columns: Vec::new(),
        }
    }

    /// Of a symmetric matrix of `n` rows, of which `entry(i, j)` with i ≥ j is asked.
    ///
    /// None where the matrix is not positive definite.
    pub fn new(n: usize, mut entry: impl FnMut(usize, usize) -> f64) -> Option<Self> {
        let mut columns: Vec<Vec<f64>> = (0..n)
            .map(|j| (j..n).map(|i| entry(i, j)).collect())
            .collect();
        wide(Factor(&mut columns))?;
        Some(Self { n, columns })
    }

    /// Rows.
    pub fn len(&self) -> usize {
        self.n
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.n == 0
    }

    /// Adds a last row (CB §4.5, equation 15); `row` ends with its diagonal entry.
    ///
    /// None where the matrix would not be positive definite; it is then as before.
    pub fn append(&mut self, row: &[f64]) -> Option<()> {
        let mut x = row[..self.n].to_vec();
        wide(Forward(self, &mut x));
        let pivot = row[self.n] - x.iter().map(|x| x * x).sum::<f64>();
        if vanishes(pivot) {
            return None;
        }
        for (column, x) in self.columns.iter_mut().zip(&x) {
            column.push(*x);
        }
        self.columns.push(vec![pivot.sqrt()]);
        self.n += 1;
        Some(())
    }

    /// Takes a row and its column out (CB §4.5, equation 17).
    pub fn remove(&mut self, at: usize) {
        let mut x = self.columns.remove(at);
        x.remove(0);
        for (j, column) in self.columns[..at].iter_mut().enumerate() {
            column.remove(at - j);
        }
        self.n -= 1;
        wide(Update(self, &mut x, at));
    }

    /// Puts another row and column in the place of one: `row` has the entries for every row, its own included.
    ///
    /// None where the matrix would not be positive definite; the row is then gone.
    pub fn replace(&mut self, at: usize, row: &[f64]) -> Option<()> {
        // Two updates of rank one, as CB's ½(x + y)(x + y)ᵀ − ½(x − y)(x − y)ᵀ, but without its downdate, which is the
        // one that may fail on the way: the row leaves (an update) and comes back at the same place.
        let n = self.n;
        self.remove(at);
        let mut x: Vec<f64> = (0..n).filter(|&i| i != at).map(|i| row[i]).collect();
        // Above the row nothing changes but its own entries; below, an update with a minus.
        for j in 0..at {
            let column = &self.columns[j];
            let head = x[j] / column[0];
            x[j] = head;
            subtract(&mut x[j + 1..], &column[1..], head);
        }
        let pivot = row[at] - x[..at].iter().map(|x| x * x).sum::<f64>();
        if vanishes(pivot) {
            return None;
        }
        let diagonal = pivot.sqrt();
        let mut below: Vec<f64> = x[at..].iter().map(|x| x / diagonal).collect();
        let mut column = vec![diagonal];
        column.extend_from_slice(&below);
        self.downdate(&mut below, at)?;
        for (j, left) in self.columns[..at].iter_mut().enumerate() {
            left.insert(at - j, x[j]);
        }
        self.columns.insert(at, column);
        self.n += 1;
        Some(())
    }

    /// `x ← (LLᵀ)⁻¹·x`.
    pub fn solve(&self, x: &mut [f64]) {
        wide(Both(self, x));
    }

    #[inline(always)]
    fn forward(&self, x: &mut [f64]) {
        for (j, column) in self.columns.iter().enumerate() {
            let head = x[j] / column[0];
            x[j] = head;
            subtract(&mut x[j + 1..self.n], &column[1..], head);
        }
    }

    /// The factor of `LLᵀ + xxᵀ` for the rows from `from` on; x starts there.
    #[inline(always)]
    fn update(&mut self, x: &mut [f64], from: usize) {
        for j in from..self.n {
            let column = &mut self.columns[j];
            let (head, tail) = (x[j - from], &mut x[j - from + 1..]);
            let r = column[0].hypot(head);
            let (c, s) = (r / column[0], head / column[0]);
            column[0] = r;
            for (l, x) in column[1..].iter_mut().zip(tail) {
                *l = (*l + s * *x) / c;
                *x = c * *x - s * *l;
            }
        }
    }

    /// The same with a minus; none where nothing positive is left.
    #[inline(always)]
    fn downdate(&mut self, x: &mut [f64], from: usize) -> Option<()> {
        for j in from..self.n {
            let column = &mut self.columns[j];
            let (head, tail) = (x[j - from], &mut x[j - from + 1..]);
            let square = (column[0] - head) * (column[0] + head);
            if vanishes(square) {
                return None;
            }
            let r = square.sqrt();
            let (c, s) = (r / column[0], head / column[0]);
            column[0] = r;
            for (l, x) in column[1..].iter_mut().zip(tail) {
                *l = (*l - s * *x) / c;
                *x = c * *x - s * *l;
            }
        }
        Some(())
    }
}

struct Factor<'a>(&'a mut [Vec<f64>]);

impl Wide for Factor<'_> {
    type Output = Option<()>;

    #[inline(always)]
    fn run<S: Simd>(self, _simd: S) -> Option<()> {
        for j in 0..self.0.len() {
            let (done, rest) = self.0.split_at_mut(j);
            let column = &mut rest[0];
            for (i, before) in done.iter().enumerate() {
                let tail = &before[j - i..];
                subtract(column, tail, tail[0]);
            }
            let pivot = column[0];
            if vanishes(pivot) {
                return None;
            }
            let scale = pivot.sqrt().recip();
            for x in column.iter_mut() {
                *x *= scale;
            }
        }
        Some(())
    }
}

struct Forward<'a>(&'a Cholesky, &'a mut [f64]);

impl Wide for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _simd: S) {
        self.0.forward(self.1);
    }
}

/// Forward and back.
struct Both<'a>(&'a Cholesky, &'a mut [f64]);

impl Wide for Both<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _simd: S) {
        let Self(of, x) = self;
        of.forward(x);
        for (j, column) in of.columns.iter().enumerate().rev() {
            let tail = dot(&column[1..], &x[j + 1..of.n]);
            x[j] = (x[j] - tail) / column[0];
        }
    }
}

struct Update<'a>(&'a mut Cholesky, &'a mut [f64], usize);

impl Wide for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _simd: S) {
        self.0.update(self.1, self.2);
    }
}

/// Whether a pivot is not positive, or no more so than rounding would make it.
#[inline(always)]
fn vanishes(pivot: f64) -> bool {
    pivot.is_nan() || pivot <= 1e-13
}

#[inline(always)]
fn subtract(to: &mut [f64], from: &[f64], factor: f64) {
    for (to, from) in to.iter_mut().zip(from) {
        *to -= factor * from;
    }
}

#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 16];
    let (a, a_rest) = a.as_chunks::<16>();
    let (b, b_rest) = b.as_chunks::<16>();
    for (a, b) in a.iter().zip(b) {
        for i in 0..16 {
            lanes[i] += a[i] * b[i];
        }
    }
    lanes.iter().sum::<f64>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::super::coupling::{Coupling, Place};
    use super::super::synthetic::{Random, ball};
    use super::*;

    fn fresh(places: &[Place]) -> Cholesky {
        let coupling = Coupling::default();
        Cholesky::new(places.len(), |i, j| entry(&coupling, places, i, j)).unwrap()
    }

    fn entry(coupling: &Coupling, places: &[Place], i: usize, j: usize) -> f64 {
        if i == j {
            1.01
        } else {
            coupling.between(&places[i], &places[j])
        }
    }

    fn difference(a: &Cholesky, b: &Cholesky) -> f64 {
        assert_eq!(a.len(), b.len());
        let pairs = a.columns.iter().flatten().zip(b.columns.iter().flatten());
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn adding_removing_and_moving_by_rank_one_is_as_factoring_anew() {
        let coupling = Coupling::default();
        let pool = ball(400, 0.03, 0.5e-3, 3e-3, 5);
        let mut random = Random::new(9);
        let mut places = pool[..20].to_vec();
        let mut factor = fresh(&places);
        for new in &pool[20..] {
            match random.bits() % 3 {
                0 => {
                    places.push(*new);
                    let n = places.len();
                    let row: Vec<_> = (0..n)
                        .map(|i| entry(&coupling, &places, i, n - 1))
                        .collect();
                    factor.append(&row).unwrap();
                }
                1 if places.len() > 2 => {
                    let at = random.bits() as usize % places.len();
                    places.remove(at);
                    factor.remove(at);
                }
                _ => {
                    let at = random.bits() as usize % places.len();
                    places[at] = *new;
                    let row: Vec<_> = (0..places.len())
                        .map(|i| entry(&coupling, &places, i, at))
                        .collect();
                    factor.replace(at, &row).unwrap();
                }
            }
        }
        let off = difference(&factor, &fresh(&places));
        println!(
            "380 updates, {} rows: factor off by {off:.1e}",
            places.len()
        );
        assert!(off < 1e-12, "{off}");
    }

    #[test]
    fn it_solves() {
        let places = ball(90, 0.03, 0.5e-3, 3e-3, 1);
        let factor = fresh(&places);
        let mut random = Random::new(2);
        let x: Vec<f64> = places.iter().map(|_| random.unit()).collect();
        let coupling = Coupling::default();
        let mut b: Vec<f64> = (0..90)
            .map(|i| {
                (0..90)
                    .map(|j| entry(&coupling, &places, i, j) * x[j])
                    .sum()
            })
            .collect();
        factor.solve(&mut b);
        assert!(b.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-12));
    }

    #[test]
    fn what_is_not_definite_is_refused() {
        assert!(Cholesky::new(2, |i, j| if i == j { 1.0 } else { 1.5 }).is_none());
        let mut one = Cholesky::new(1, |_, _| 1.0).unwrap();
        assert!(one.append(&[2.0, 1.0]).is_none());
        assert_eq!(one.len(), 1);
    }
}
