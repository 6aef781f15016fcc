//! Lines as programs write them, millions in a file: `v x y z`, `vn x y z` and `f a b c ...` with plain numbers. What is unusual about
//! a line, above all whatever is wrong with it, is left to [`scan`](super::scan), which finds the same in the others, more slowly.

use super::scan::{Corner, Scan};
use glam::DVec3;

/// More digits than these may not be exact in an f64.
const DIGITS: usize = 15;

/// Powers of ten up to [`DIGITS`], exact.
const TENS: [f64; DIGITS + 1] =
    [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];

impl Scan {
    /// Takes a line, without its end, if it is plain.
    pub(super) fn take_plain(&mut self, line: &[u8]) -> bool {
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        match line {
            [b'v', b' ', rest @ ..] => coordinates(rest).map(|p| self.positions.push(p)).is_some(),
            [b'v', b'n', b' ', rest @ ..] => coordinates(rest).map(|n| self.normals.push(n)).is_some(),
            [b'f', b' ', rest @ ..] => self.take_face(rest),
            _ => false,
        }
    }

    fn take_face(&mut self, line: &[u8]) -> bool {
        let first = self.corners.len();
        let mut rest = Rest(line);
        while let Some(corner) = self.corner(&mut rest) {
            self.corners.push(corner);
        }
        let alike = self.corners[first..].windows(2).all(|w| (w[0].normal > 0) == (w[1].normal > 0));
        let taken = rest.is_done() && alike && self.corners.len() >= first + 3;
        if taken {
            self.ends.push(self.corners.len());
        } else {
            self.corners.truncate(first);
        }
        taken
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn`, of vertices that have been read.
    fn corner(&self, rest: &mut Rest) -> Option<Corner> {
        rest.skip_blanks();
        let position = rest.index(self.positions.len())?;
        let mut normal = 0;
        if rest.skip(b'/') {
            let texture = rest.digits().1;
            if rest.skip(b'/') {
                normal = rest.index(self.normals.len())?;
            } else if texture == 0 {
                return None;
            }
        }
        rest.at_end_of_word().then_some(Corner { position, normal })
    }
}

/// Three numbers and nothing else.
fn coordinates(line: &[u8]) -> Option<DVec3> {
    let mut rest = Rest(line);
    let at = DVec3::new(rest.number()?, rest.number()?, rest.number()?);
    rest.is_done().then_some(at)
}

/// What is left of a line.
struct Rest<'a>(&'a [u8]);

impl Rest<'_> {
    fn skip(&mut self, byte: u8) -> bool {
        match self.0.split_first() {
            Some((&first, rest)) if first == byte => {
                self.0 = rest;
                true
            }
            _ => false,
        }
    }

    fn skip_blanks(&mut self) {
        while self.skip(b' ') {}
    }

    fn is_done(&mut self) -> bool {
        self.skip_blanks();
        self.0.is_empty()
    }

    fn at_end_of_word(&self) -> bool {
        self.0.first().is_none_or(|&c| c == b' ')
    }

    /// The value of the next digits, and how many there are; the value of more than [`DIGITS`] means nothing.
    fn digits(&mut self) -> (u64, usize) {
        let (mut value, mut count) = (0u64, 0);
        while let Some((digit, rest)) = self.0.split_first().filter(|(c, _)| c.is_ascii_digit()) {
            value = value.wrapping_mul(10).wrapping_add(u64::from(digit - b'0'));
            count += 1;
            self.0 = rest;
        }
        (value, count)
    }

    /// An index from 1 to `count`.
    fn index(&mut self, count: usize) -> Option<u32> {
        let (index, digits) = self.digits();
        ((1..=9).contains(&digits) && (1..=count as u64).contains(&index)).then_some(index as u32)
    }

    /// A decimal number. The quotient of two whole numbers that f64 holds exactly is rounded once: this is the nearest f64, as the
    /// standard library would find (Clinger 1990, "How to Read Floating Point Numbers Accurately").
    fn number(&mut self) -> Option<f64> {
        self.skip_blanks();
        let negative = self.skip(b'-');
        let (whole, before) = self.digits();
        let (part, after) = if self.skip(b'.') { self.digits() } else { (0, 0) };
        if !(1..=DIGITS).contains(&(before + after)) || !self.at_end_of_word() {
            return None;
        }
        let size = (whole * 10u64.pow(after as u32) + part) as f64 / TENS[after];
        Some(if negative { -size } else { size })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_the_standard_library() {
        let mut rng = crate::math::Rng::new(4, 0);
        let mut taken = 0;
        for text in ["0", "-0", "-0.0", "1.", ".5", "-.25", "123456789012345", "0.00000000000001", "9.99999"]
        {
            let value = Rest(text.as_bytes()).number().expect(text);
            assert_eq!(value.to_bits(), text.parse::<f64>().unwrap().to_bits(), "{text}");
        }
        for _ in 0..2000 {
            let text = format!("{:.*}", (12.0 * rng.unit()) as usize, 2e3 * rng.unit() - 1e3);
            if let Some(value) = Rest(text.as_bytes()).number() {
                assert_eq!(value.to_bits(), text.parse::<f64>().unwrap().to_bits(), "{text}");
                taken += 1;
            }
        }
        assert!(taken > 1500, "{taken}");
        for text in
            ["", "-", ".", "1e3", "nan", "inf", "+1", "1,2", "0x1", "1234567890.1234567", "--1", "1.2.3"]
        {
            assert!(Rest(text.as_bytes()).number().is_none(), "{text}");
        }
    }

    #[test]
    fn only_plain_lines_are_taken() {
        let mut scan = Scan::default();
        for line in [
            "v 0 0 0",
            "v  1.5 -2 3\r",
            "v 1 1 0 ",
            "vn 0 0 1",
            "f 1 2 3",
            "f 1//1 2//1 3//1 1//1",
            "f 1/7/1 2/8/1 3/9/1",
            "f 1/1 2/2 3/3",
        ] {
            assert!(scan.take_plain(line.as_bytes()), "{line}");
        }
        assert_eq!(
            (scan.positions.len(), scan.normals.len(), scan.ends.as_slice()),
            (3, 1, &[3, 7, 10, 13][..])
        );
        let corners = scan.corners.len();
        let unusual = [
            "v 0 0",
            "v 0 0 0 1",
            "v 0 0 0 # x",
            "v 1 2 3\\",
            "v\t1 2 3",
            "v a b c",
            "f 1 2",
            "f 1 2 4",
            "f 0 1 2",
            "f -1 -2 -3",
            "f 1 2 3//1",
            "f 1/ 2/ 3/",
            "f 1/1/ 2/1/ 3/1/",
            "f 1 2 3 #",
            "f 1 2 3.0",
            "f 1//2 2//2 3//2",
            "g x",
            "",
            "usemtl v",
            "f 1/1/1/1 2/1/1 3/1/1",
        ];
        for line in unusual {
            assert!(!scan.take_plain(line.as_bytes()), "{line}");
        }
        assert_eq!(
            (scan.positions.len(), scan.normals.len(), scan.corners.len(), scan.ends.len()),
            (3, 1, corners, 4)
        );
    }
}
