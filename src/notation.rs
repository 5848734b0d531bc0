//! Every symbol of the paper, with its name in the code, its unit and shape, and where it is
//! defined.
//!
//! The paper is L. Cedro, *Model parameter on-line identification with nonlinear parametrization –
//! manipulator model*, Technical Transactions e2022007 (2022), doi 10.37705/TechTrans/e2022007. `J`
//! is the number of joints, `P` the number of parameters. SI units and radians everywhere inside;
//! at every edge the unit is part of the name.
//!
//! | paper | code | unit, shape | equation |
//! |---|---|---|---|
//! | φ_j, φ̇_j, φ̈_j, φ⃛_j (joint variable) | `q`, `dq`, `ddq`, `dddq` | rad, rad/s, rad/s², rad/s³; J | (13), (19)–(27) |
//! | φ_n (signal vector) | `regressor`, −∂f/∂θ at θ̂ | P (or the equation's own parameters) | (1), (7) |
//! | φ_z | `setpoint` | rad; J | (13) |
//! | u_z | `input`, or `voltage` if its kind is known | V; J | (12), (13) |
//! | θ, θ̂ | `theta`, `theta_hat` | as the model says; P | (1), (25) |
//! | θ̂ − θ | `theta_error` | P | |
//! | f_n(θ̂) | `innovation` before the update, `residual` after it | the equation's unit | (5), (8) |
//! | v_n | `target` | the equation's unit | (1), (7) |
//! | Γ_m | `covariance`, not scaled by σ² | P×P | (3), (4), (8) |
//! | Γ_m⁻¹ | `information`, not scaled by σ² | P×P | (4), (9) |
//! | Π_m | the covariance before the bound is applied | P×P | (10) |
//! | λ | `forgetting_factor`, in (0, 1\]; others write α = 1/λ | 1 | (2), (6) |
//! | ε | `information_floor` | 1/θ² | after (9) |
//! | G | `CovarianceBound` | \[0, 1\] → \[0, 1\] | (10), (11) |
//! | N | `block_len` | samples | before (6) |
//! | m, α(m) | `block`, counted from 1: samples (m−1) N … m N − 1 | | before (6) |
//! | Δ | `sample_period_s` | s | §5 |
//! | K_p, K_d | `kp_v_per_rad`, `kd_v_s_per_rad` | V/rad, V s/rad; J | (13) |
//! | R_w, L | `winding_resistance_ohm`, `winding_inductance_h` | Ω, H; J | (14), (15) |
//! | k_e | `back_emf_constant_v_s_per_rad` | V s/rad; J | (16) |
//! | k_m | `torque_constant_n_m_per_a` | N m/A; J | (18) |
//! | i_w | `current` | A; J | (14), (18) |
//! | l, l_c, m | `length`, `com_distance`, `mass` | m, m, kg | (19)–(22) |
//! | J_c | `inertia` | kg m² | (21) |
//! | E, U | `kinetic_energy`, `potential_energy` | J | (20)–(22) |
//! | g | `gravity` | m/s² | (22) |
