//! Addition to `f32` values in device memory that other units add to as well.
//!
//! Where the device adds floats atomically it is one instruction. Elsewhere the memory is bound as
//! integers and a unit takes the value out, adds to it and puts it back, again with what others
//! put there in between: exchanges alone, because a compare-exchange may fail for no reason on
//! Metal, and CubeCL doesn't tell that from success.

use cubecl::features::AtomicUsage;
use cubecl::prelude::*;

/// How floats are added atomically.
#[cube]
pub(crate) trait FloatAdd: Send + Sync + 'static {
    /// What the memory is bound as.
    type Word: Numeric;

    /// Adds `value` to `target`.
    fn add(target: &Atomic<Self::Word>, value: f32);
}

/// By one instruction.
pub(crate) struct NativeAdd;

#[cube]
impl FloatAdd for NativeAdd {
    type Word = f32;

    fn add(target: &Atomic<f32>, value: f32) {
        target.fetch_add(value);
    }
}

/// By exchanges of the value's bits.
pub(crate) struct ExchangeAdd;

#[cube]
impl FloatAdd for ExchangeAdd {
    type Word = u32;

    fn add(target: &Atomic<u32>, value: f32) {
        let mut own = value;
        // The bits of zero say that nobody put anything there since the value was taken out.
        while u32::reinterpret(own) != 0u32 {
            let taken = target.exchange(0u32);
            let sum = f32::reinterpret(taken) + own;
            own = f32::reinterpret(target.exchange(u32::reinterpret(sum)));
        }
    }
}

/// Whether the device has [`NativeAdd`].
pub(crate) fn has_native_add(client: &Client) -> bool {
    let float = Type::atomic(f32::elem_type_native());
    client
        .properties()
        .atomic_type_usage(float)
        .contains(AtomicUsage::Add)
}
