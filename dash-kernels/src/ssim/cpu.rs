//! placeholder
/// x
pub fn ssim(x: &[f32], _y: &[f32], _shape: [usize; 3]) -> Vec<f32> {
    x.to_vec()
}
/// x
pub fn ssim_vjp(_x: &[f32], _y: &[f32], v: &[f32], _shape: [usize; 3]) -> (Vec<f32>, Vec<f32>) {
    (v.to_vec(), v.to_vec())
}
