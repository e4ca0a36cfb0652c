//! Numbers in binary files.

/// Order of a number's bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ByteOrder {
    Little,
    Big,
}

/// Type of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    /// Bytes of a number.
    pub const fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// Whether it can have a fraction.
    pub const fn is_real(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// The number at the start of the bytes; `None` if there are too few.
    #[inline]
    pub fn read(self, bytes: &[u8], order: ByteOrder) -> Option<f64> {
        Some(match self {
            Self::I8 => f64::from(i8::from_le_bytes(leading(bytes, order)?)),
            Self::U8 => f64::from(u8::from_le_bytes(leading(bytes, order)?)),
            Self::I16 => f64::from(i16::from_le_bytes(leading(bytes, order)?)),
            Self::U16 => f64::from(u16::from_le_bytes(leading(bytes, order)?)),
            Self::I32 => f64::from(i32::from_le_bytes(leading(bytes, order)?)),
            Self::U32 => f64::from(u32::from_le_bytes(leading(bytes, order)?)),
            Self::I64 => i64::from_le_bytes(leading(bytes, order)?) as f64,
            Self::U64 => u64::from_le_bytes(leading(bytes, order)?) as f64,
            Self::F32 => f64::from(f32::from_le_bytes(leading(bytes, order)?)),
            Self::F64 => f64::from_le_bytes(leading(bytes, order)?),
        })
    }

    /// Rounds a number of a text to this type.
    pub fn hold(self, number: f64) -> f64 {
        match self {
            Self::F32 => f64::from(number as f32),
            Self::F64 => number,
            _ => number.trunc(),
        }
    }
}

/// The first bytes, the least significant one first.
#[inline]
fn leading<const N: usize>(bytes: &[u8], order: ByteOrder) -> Option<[u8; N]> {
    let mut found = *bytes.first_chunk::<N>()?;
    if order == ByteOrder::Big {
        found.reverse();
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_orders_are_read() {
        let cases: [(Scalar, &[u8], f64); 6] = [
            (Scalar::I8, &[0xff], -1.0),
            (Scalar::U16, &[1, 2], 513.0),
            (Scalar::I32, &[0xfe, 0xff, 0xff, 0xff], -2.0),
            (Scalar::U64, &[0, 1, 0, 0, 0, 0, 0, 0], 256.0),
            (Scalar::F32, &[0, 0, 0xc0, 0x3f], 1.5),
            (Scalar::F64, &[0, 0, 0, 0, 0, 0, 4, 0x40], 2.5),
        ];
        for (scalar, bytes, value) in cases {
            let backwards: Vec<u8> = bytes.iter().rev().copied().collect();
            assert_eq!(scalar.size(), bytes.len());
            assert_eq!(scalar.read(bytes, ByteOrder::Little), Some(value));
            assert_eq!(scalar.read(&backwards, ByteOrder::Big), Some(value));
            assert_eq!(scalar.read(&bytes[1..], ByteOrder::Little), None);
        }
    }

    #[test]
    fn text_is_rounded_to_the_declared_type() {
        let held = [Scalar::F32, Scalar::F64, Scalar::U8].map(|scalar| scalar.hold(3.1));
        assert_eq!(Some(held), Some([f64::from(3.1_f32), 3.1, 3.0]));
    }
}
