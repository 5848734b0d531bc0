//! Workspace of a group, allocated once.

/// Matrices (n × n) and vectors (n) that carry nothing from one call to the next.
#[derive(Debug, Clone)]
pub struct Workspace {
    pub total: Vec<f64>,
    pub gain: Vec<f64>,
    pub transition: Vec<f64>,
    pub a: Vec<f64>,
    pub b: Vec<f64>,
    pub gradient: Vec<f64>,
    pub offset: Vec<f64>,
    pub noise: Vec<f64>,
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    pub scale: Vec<f64>,
    pub free: Vec<bool>,
    pub regressor: Vec<f64>,
}

impl Workspace {
    /// Matrices n × n and vectors n.
    pub fn new(n: usize) -> Self {
        let (matrix, vector) = (vec![0.0; n * n], vec![0.0; n]);
        Self {
            total: matrix.clone(),
            gain: matrix.clone(),
            transition: matrix.clone(),
            a: matrix.clone(),
            b: matrix,
            gradient: vector.clone(),
            offset: vector.clone(),
            noise: vector.clone(),
            lower: vector.clone(),
            upper: vector.clone(),
            scale: vector.clone(),
            free: vec![true; n],
            regressor: vector,
        }
    }
}
