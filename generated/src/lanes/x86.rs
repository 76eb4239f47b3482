//! Vectors of four and eight numbers, of processors that have AVX2 and AVX-512.
//!
//! This crate is compiled for any processor, so that the instructions of these are a matter of run time: a function that holds
//! them must not run elsewhere, which the compiler calls unsafe. All of that stands here; [`super::Width`] says where it may.

#![allow(unsafe_code)]

use core::arch::x86_64::*;

use super::{Eight, Lanewise, eight::Register, eight::in_parts, vector::Vector, vector::scalar_of_vector};

/// Calls instructions that the processor has.
macro_rules! has {
    ($of:expr) => {
        // SAFETY: only `in_avx2` and `in_avx512` make numbers of the types below, and `Width` calls them where the processor has
        // these instructions.
        unsafe { $of }
    };
}

/// A vector: its lanes, its register, and the register's instructions.
macro_rules! vector {
    ($vector:ident: [f64; $lanes:literal] in $numbers:ident, $bits:ident {
        number: [$splat:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $sqrt:ident],
        bits: [$splat_bits:ident, $and:ident, $xor:ident, $add_bits:ident, $sub_bits:ident, $left:ident, $right:ident],
        cast: [$to_bits:ident, $to_numbers:ident],
        if_less: $if_less:expr,
        all_at_most: $all_at_most:expr,
    }) => {
        #[derive(Clone, Copy)]
        struct $vector($numbers);

        impl $vector {
            #[inline(always)]
            fn bits(self) -> $bits {
                has!($to_bits(self.0))
            }

            #[inline(always)]
            fn numbers(bits: $bits) -> Self {
                $vector(has!($to_numbers(bits)))
            }
        }

        impl From<[f64; $lanes]> for $vector {
            #[inline(always)]
            fn from(numbers: [f64; $lanes]) -> Self {
                // SAFETY: any bits are numbers, and both types consist of as many.
                $vector(unsafe { core::mem::transmute::<[f64; $lanes], $numbers>(numbers) })
            }
        }

        impl From<$vector> for [f64; $lanes] {
            #[inline(always)]
            fn from(vector: $vector) -> Self {
                // SAFETY: as above.
                unsafe { core::mem::transmute::<$numbers, [f64; $lanes]>(vector.0) }
            }
        }

        impl Vector for $vector {
            #[inline(always)]
            fn of_bits(bits: u64) -> Self {
                Self::numbers(has!($splat_bits(bits.cast_signed())))
            }
            #[inline(always)]
            fn both(self, other: Self) -> Self {
                Self::numbers(has!($and(self.bits(), other.bits())))
            }
            #[inline(always)]
            fn either(self, other: Self) -> Self {
                Self::numbers(has!($xor(self.bits(), other.bits())))
            }
            #[inline(always)]
            fn plus_bits(self, other: Self) -> Self {
                Self::numbers(has!($add_bits(self.bits(), other.bits())))
            }
            #[inline(always)]
            fn minus_bits(self, other: Self) -> Self {
                Self::numbers(has!($sub_bits(self.bits(), other.bits())))
            }
            #[inline(always)]
            fn left<const BY: u32>(self) -> Self {
                Self::numbers(has!($left(self.bits(), _mm_cvtsi32_si128(BY.cast_signed()))))
            }
            #[inline(always)]
            fn right<const BY: u32>(self) -> Self {
                Self::numbers(has!($right(self.bits(), _mm_cvtsi32_si128(BY.cast_signed()))))
            }
            #[inline(always)]
            fn all_within(self, limit: f64) -> bool {
                has!($all_at_most(crate::Scalar::abs(self).0, $splat(limit)))
            }
            #[inline(always)]
            fn each(self, of: impl Fn(f64) -> f64) -> Self {
                <[f64; $lanes]>::from(self).map(of).into()
            }
        }

        scalar_of_vector!($vector {
            add: |a: $vector, b: $vector| $vector(has!($add(a.0, b.0))),
            sub: |a: $vector, b: $vector| $vector(has!($sub(a.0, b.0))),
            mul: |a: $vector, b: $vector| $vector(has!($mul(a.0, b.0))),
            div: |a: $vector, b: $vector| $vector(has!($div(a.0, b.0))),
            sqrt: |a: $vector| $vector(has!($sqrt(a.0))),
            constant: |value| $vector(has!($splat(value))),
            if_less: |a: $vector, b: $vector, then: $vector, otherwise: $vector| {
                $vector(has!($if_less(a.0, b.0, then.0, otherwise.0)))
            },
        });
    };
}

vector!(InAvx2: [f64; 4] in __m256d, __m256i {
    number: [_mm256_set1_pd, _mm256_add_pd, _mm256_sub_pd, _mm256_mul_pd, _mm256_div_pd, _mm256_sqrt_pd],
    bits: [
        _mm256_set1_epi64x, _mm256_and_si256, _mm256_xor_si256, _mm256_add_epi64, _mm256_sub_epi64, _mm256_sll_epi64,
        _mm256_srl_epi64
    ],
    cast: [_mm256_castpd_si256, _mm256_castsi256_pd],
    if_less: |a, b, then, otherwise| _mm256_blendv_pd(otherwise, then, _mm256_cmp_pd::<_CMP_LT_OQ>(a, b)),
    all_at_most: |a, b| _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LE_OQ>(a, b)) == 0b1111,
});

vector!(InAvx512: [f64; 8] in __m512d, __m512i {
    number: [_mm512_set1_pd, _mm512_add_pd, _mm512_sub_pd, _mm512_mul_pd, _mm512_div_pd, _mm512_sqrt_pd],
    bits: [
        _mm512_set1_epi64, _mm512_and_si512, _mm512_xor_si512, _mm512_add_epi64, _mm512_sub_epi64, _mm512_sll_epi64,
        _mm512_srl_epi64
    ],
    cast: [_mm512_castpd_si512, _mm512_castsi512_pd],
    if_less: |a, b, then, otherwise| _mm512_mask_blend_pd(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b), otherwise, then),
    all_at_most: |a, b| _mm512_cmp_pd_mask::<_CMP_LE_OQ>(a, b) == 0b1111_1111,
});

/// Four states after the other. [`super::Width`] has seen that the processor has AVX2.
#[inline]
pub(super) fn in_avx2<F: Lanewise<I, O>, const I: usize, const O: usize>(
    function: &F,
    given: &[Eight; I],
    results: &mut [Eight; O],
) {
    #[target_feature(enable = "avx2")]
    fn compiled<F: Lanewise<I, O>, const I: usize, const O: usize>(
        function: &F,
        given: &[Eight; I],
        results: &mut [Eight; O],
    ) {
        in_parts::<InAvx2, 4, I, O>(function, given, results);
    }
    has!(compiled(function, given, results));
}

/// All eight states. [`super::Width`] has seen that the processor has AVX-512.
#[inline]
pub(super) fn in_avx512<F: Lanewise<I, O>, const I: usize, const O: usize>(
    function: &F,
    given: &[Eight; I],
    results: &mut [Eight; O],
) {
    #[target_feature(enable = "avx512f")]
    fn compiled<F: Lanewise<I, O>, const I: usize, const O: usize>(
        function: &F,
        given: &[Eight; I],
        results: &mut [Eight; O],
    ) {
        in_parts::<InAvx512, 8, I, O>(function, given, results);
    }
    has!(compiled(function, given, results));
}

/// Which of the registers Miri, which knows no `cpuid`, was told to have.
#[cfg(miri)]
pub(super) fn found() -> [Option<Register>; 2] {
    [
        cfg!(target_feature = "avx2").then_some(Register::Avx2),
        cfg!(target_feature = "avx512f").then_some(Register::Avx512),
    ]
}

/// Which of the registers the processor has and the system keeps (Intel 64 Architectures Software Developer's Manual, volume 1,
/// sections 14.3 and 15.2).
#[cfg(not(miri))]
pub(super) fn found() -> [Option<Register>; 2] {
    #[target_feature(enable = "xsave")]
    fn kept() -> u64 {
        has!(_xgetbv(0))
    }
    /// Registers that a system may keep.
    const AVX: u64 = 0b110;
    const AVX_512: u64 = 0b1110_0110;
    // SAFETY: every 64-bit processor has this instruction, and `kept` is called where there is what it calls.
    #[allow(unused_unsafe)]
    unsafe {
        let features = __cpuid(1).ecx;
        let is_set = |bits: u32, bit: u32| bits >> bit & 1 == 1;
        // The system keeps extended registers, and the processor has AVX.
        if !(is_set(features, 27) && is_set(features, 28) && __cpuid(0).eax >= 7) {
            return [None, None];
        }
        let (extended, kept) = (__cpuid_count(7, 0).ebx, kept());
        let has_avx2 = is_set(extended, 5) && kept & AVX == AVX;
        // What the compiler takes for granted where there is AVX-512: fused multiply-add, and half precision.
        let is_usual = has_avx2 && is_set(features, 12) && is_set(features, 29);
        [
            has_avx2.then_some(Register::Avx2),
            (is_usual && is_set(extended, 16) && kept & AVX_512 == AVX_512).then_some(Register::Avx512),
        ]
    }
}
