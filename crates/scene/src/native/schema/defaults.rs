//! Defaults of fields, and when a field need not be written.

use crate::native::values::{Color, ColorValue, FloatValue};

pub(super) fn one() -> f64 {
    1.0
}
pub(super) fn one_f32() -> f32 {
    1.0
}
pub(super) fn is_one(x: &f32) -> bool {
    *x == 1.0
}
pub(super) fn no(x: &bool) -> bool {
    !*x
}
pub(super) fn white() -> ColorValue {
    ColorValue::Const([1.0; 3])
}
pub(super) fn white_color() -> Color {
    Color([1.0; 3])
}
pub(super) fn half() -> ColorValue {
    ColorValue::Const([0.5; 3])
}
pub(super) fn zero() -> FloatValue {
    FloatValue::Const(0.0)
}
pub(super) fn glass() -> f32 {
    1.5
}
pub(super) fn black() -> Color {
    Color([0.0; 3])
}
