//! Derived values of any [`Plant`], with their gradients by dual numbers.

use super::{DerivedQuantity, DerivedValues, MAX_PARAMS, Plant};
use num_dual::Dual64;

/// The values that a plant [derives](Plant::derived) from its parameters.
#[derive(Debug, Clone)]
pub struct PlantDerived<P>(pub P);

impl<P: Plant> DerivedValues for PlantDerived<P> {
    fn quantities(&self) -> &[DerivedQuantity] {
        self.0.derived()
    }

    fn value_and_gradient(&self, index: usize, theta: &[f64], gradient: &mut [f64]) -> f64 {
        let params = theta.len();
        let mut dual = [Dual64::from(0.0); MAX_PARAMS];
        for (dual, &value) in dual.iter_mut().zip(theta) {
            dual.re = value;
        }
        for parameter in 0..params {
            dual[parameter].eps = 1.0;
            gradient[parameter] = self.0.derived_value(index, &dual[..params]).eps;
            dual[parameter].eps = 0.0;
        }
        let value = self.0.derived_value(index, theta);
        if value.is_finite() { value } else { f64::NAN }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Equation, Parameter, Scalar};

    struct Disc;

    impl Plant for Disc {
        fn name(&self) -> &str {
            "disc"
        }
        fn joints(&self) -> usize {
            1
        }
        fn input_unit(&self) -> &str {
            "N m"
        }
        fn parameters(&self) -> &[Parameter] {
            const PARAMETERS: &[Parameter] = &[
                Parameter::positive("inertia", "kg m^2", "about the axis", 1.0),
                Parameter::positive("mass", "kg", "of the disc", 1.0),
            ];
            PARAMETERS
        }
        fn equations(&self) -> &[Equation] {
            const EQUATIONS: &[Equation] = &[Equation::new("axis", 0, 1.0, 1, 0..2)];
            EQUATIONS
        }
        fn derived(&self) -> &[DerivedQuantity] {
            const DERIVED: &[DerivedQuantity] = &[DerivedQuantity::new("radius", "m", "of a disc of this inertia")];
            DERIVED
        }
        /// J = m r²/2
        fn derived_value<D: Scalar>(&self, _index: usize, theta: &[D]) -> D {
            (theta[0] / theta[1] * 2.0).sqrt()
        }
        fn terms<D: Scalar>(&self, _equation: usize, _q: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
            g[1] = theta[0] * dq[0];
        }
    }

    #[test]
    fn val_a_derived_value_has_the_gradient_of_its_formula() {
        let (j, m) = (0.5_f64, 4.0);
        let radius = (2.0 * j / m).sqrt();
        let mut gradient = [0.0; 2];
        let derived = PlantDerived(Disc);
        assert_eq!(derived.value_and_gradient(0, &[j, m], &mut gradient), radius);
        // dr/dJ = r/(2 J), dr/dm = −r/(2 m); three operations, so only rounding
        assert!((gradient[0] - radius / (2.0 * j)).abs() < 1e-15);
        assert!((gradient[1] + radius / (2.0 * m)).abs() < 1e-15);
        let (value, std) = derived.value_and_std(0, &[j, m], &|a, b| if a == b { 1e-4 } else { 0.0 });
        assert_eq!(value, radius);
        assert!((std - 0.01 * gradient[0].hypot(gradient[1])).abs() < 1e-15);
        // a mass known only to 5.6 % leaves the radius open
        let (value, std) = derived.value_and_std(0, &[j, m], &|a, b| if a == b { [1e-4, 0.05][a] } else { 0.0 });
        assert!(value == radius && std.is_nan());
        assert!(derived.value_and_gradient(0, &[j, 0.0], &mut gradient).is_nan());
    }
}
