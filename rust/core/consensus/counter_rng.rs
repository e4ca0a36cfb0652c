//! Counter-based random numbers: Philox4x64-10 (Salmon, Moraes, Dror, Shaw, *Parallel random
//! numbers: as easy as 1, 2, 3*, SC 2011).
//!
//! The numbers of an iteration depend on (seed, iteration) alone, so results do not depend on how the
//! iterations are distributed over threads. They are the words of `NumPy`'s
//! `Philox(key=seed, counter=iteration).random_raw(4)`.

const MULTIPLIERS: [u64; 2] = [0xD2E7_470E_E14C_6C93, 0xCA5A_8263_9512_1157];
const KEY_INCREMENTS: [u64; 2] = [0x9E37_79B9_7F4A_7C15, 0xBB67_AE85_84CA_A73B];
const ROUNDS: usize = 10;

/// Four random words for `counter` under `key`.
pub fn random_words(key: u64, counter: u64) -> [u64; 4] {
    let mut key = [key, 0];
    // `NumPy` increments its 256-bit counter before it generates the first block.
    let (low, carry) = counter.overflowing_add(1);
    let mut state = [low, u64::from(carry), 0, 0];
    for round in 0..ROUNDS {
        if round > 0 {
            key = [0, 1].map(|i| key[i].wrapping_add(KEY_INCREMENTS[i]));
        }
        let (high0, low0) = multiply(MULTIPLIERS[0], state[0]);
        let (high1, low1) = multiply(MULTIPLIERS[1], state[2]);
        state = [high1 ^ state[1] ^ key[0], low1, high0 ^ state[3] ^ key[1], low0];
    }
    state
}

/// Three distinct indices below `n`, drawn uniformly without replacement; `n` is at least 3.
pub fn sample_three(key: u64, counter: u64, n: usize) -> [usize; 3] {
    let words = random_words(key, counter);
    // The bias of the multiplication is below n / 2^64.
    let below = |word: u64, bound: usize| multiply(word, bound as u64).0 as usize;
    let first = below(words[0], n);
    let mut second = below(words[1], n - 1);
    second += usize::from(second >= first);
    let (low, high) = (first.min(second), first.max(second));
    let mut third = below(words[2], n - 2);
    third += usize::from(third >= low);
    third += usize::from(third >= high);
    [first, second, third]
}

fn multiply(a: u64, b: u64) -> (u64, u64) {
    let product = u128::from(a) * u128::from(b);
    ((product >> 64) as u64, product as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `np.random.Philox(counter=c, key=k).random_raw(4)`.
    #[test]
    fn agrees_with_numpy() {
        assert_eq!(random_words(0, 0), NUMPY_0_0);
        assert_eq!(random_words(7, 12345), NUMPY_7_12345);
    }

    #[test]
    fn draws_distinct_indices_uniformly() {
        let mut seen = [0_u32; 4];
        for counter in 0..1000 {
            let [a, b, c] = sample_three(1, counter, 4);
            assert!(a != b && b != c && a != c);
            for i in [a, b, c] {
                seen[i] += 1;
            }
        }
        assert!(seen.iter().all(|&count| (650..850).contains(&count)), "{seen:?}");
    }

    const NUMPY_0_0: [u64; 4] =
        [0x02F4_BA64_08E4_D89B, 0x3DD6_2B0B_9CA8_C5B2, 0x1C86_67A5_5D90_2E79, 0x907D_7A05_2FD5_B4DC];
    const NUMPY_7_12345: [u64; 4] =
        [0xBA74_CA54_C0FB_E311, 0xCD97_0338_14DC_DA48, 0x44C4_4C8F_0BEB_019E, 0x8B04_25A6_3CC0_D3C1];
}
