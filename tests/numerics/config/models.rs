//! What a configuration says about the model and its rows: a plant of a user's own, noise, the
//! velocity filter, terms of the arm.

use super::*;

/// A plant with only the required methods.
#[derive(Clone)]
struct Own {
    name: &'static str,
    parameters: Vec<Parameter>,
    equations: Vec<Equation>,
}

impl Plant for Own {
    fn name(&self) -> &str {
        self.name
    }
    fn joints(&self) -> usize {
        1
    }
    fn input_unit(&self) -> &str {
        "N m"
    }
    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }
    fn equations(&self) -> &[Equation] {
        &self.equations
    }
    fn terms<D: Scalar>(&self, _equation: usize, _q: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
        g[0] = theta[1];
        g[1] = theta[0] * dq[0];
    }
}

#[test]
fn prop_a_users_own_plant_is_a_model_beside_those_of_the_library() {
    let pendulum = Own {
        name: "pendulum",
        parameters: vec![
            Parameter::positive("inertia", "kg m^2", "about the axis", 1.5),
            Parameter::new("bias", "N m", "constant torque", -0.5),
        ],
        equations: vec![Equation::new("axis", 0, 1.0, 1, 0..2)],
    };
    let load = |own: &Own, sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
        let basis = Config::embedded("own_plant").unwrap();
        let catalog = Catalog::default().with(own.clone());
        Config::load_for(&catalog, &[basis], &sets).map_err(|e| e.to_string())
    };
    let config = load(&pendulum, &[]).unwrap();
    let options = &config.estimator.options;
    assert_eq!(config.model.definition(), &PlantDefinition::of(&pendulum));
    assert_eq!(
        options.parameters,
        [ParameterPrior::positive(1.5), ParameterPrior::new(-0.5)]
    );
    assert!(config.warnings().is_empty(), "{:?}", config.warnings());
    // its own equations are what is simulated, and the configuration that is written out says so
    assert_eq!(config.plant.sim.model(), "pendulum");
    assert_eq!(config.plant.sim.true_parameters(0.0), [1.875, -0.625]);
    let written = Catalog::default().with(pendulum.clone());
    let source = Source::Embedded {
        name: "written".to_owned(),
        text: config.to_toml(),
    };
    let again = Config::load_for(&written, &[source], &[]).unwrap();
    assert_eq!((&again.model, &again.plant), (&config.model, &config.plant));
    assert_eq!(again.config_hash(), config.config_hash());

    let config = load(
        &pendulum,
        &["estimator.theta_start=[2.0,0.1]", "estimator.fixed=[\"bias\"]"],
    )
    .unwrap();
    let of_each = config.estimator.options.parameters.iter();
    assert!(of_each.map(|p| (p.start, p.fixed)).eq([(2.0, false), (0.1, true)]));
    // models of the library remain available
    let servo = load(&pendulum, &["model.kind=servo_axis", "plant.machine=servo_axis"]).unwrap();
    assert_eq!(servo.model.name(), "servo_axis");
    let ignored = load(&pendulum, &["model.gravity_m_s2=1.6"]).unwrap();
    assert!(ignored.warnings()[0].message.contains("no effect on pendulum"));
    let message = load(&pendulum, &["model.kind=pendulun"]).unwrap_err();
    assert!(message.contains("did you mean \"pendulum\"?"), "{message}");

    let message = load(&pendulum, &["estimator.theta_start=[1.0]"]).unwrap_err();
    assert!(message.contains("expected 2 numbers"), "{message}");
    let message = load(&pendulum, &["plant.model.theta=[1.0]"]).unwrap_err();
    assert!(
        message.contains("expected 2 numbers, one per parameter of pendulum"),
        "{message}"
    );
    let message = load(&pendulum, &["plant.model.change_s=3"]).unwrap_err();
    assert!(message.contains("theta_after"), "{message}");
    let mut broken = pendulum.clone();
    broken.equations[0].parameters = 0..3;
    let message = load(&broken, &[]).unwrap_err();
    assert!(
        message.contains("equation axis") && message.contains("0..2, got 0..3"),
        "{message}"
    );
    let mut broken = pendulum.clone();
    broken.parameters[1].name = "inertia".into();
    let message = load(&broken, &[]).unwrap_err();
    assert!(message.contains("two parameters are called inertia"), "{message}");
    for (name, problem) in [
        ("manipulator", "another model has this name"),
        ("My Arm", "a-z 0-9 _ -"),
    ] {
        let message = load(
            &Own {
                name,
                ..pendulum.clone()
            },
            &[],
        )
        .unwrap_err();
        assert!(message.contains(problem), "{message}");
    }
}

#[test]
fn regress_noise_is_learnt_if_nobody_states_any_and_the_decision_is_written_out() {
    use thetabus::rows::ProjectedOptions;
    let rows = |config: &Config| -> ProjectedOptions {
        match config.identifier.rows {
            RowForm::Projected(rows) => rows,
            RowForm::Pointwise => panic!("projected rows were asked for"),
        }
    };
    let projected = "identifier.rows=projected";
    let learnt = load("", &[projected]).unwrap();
    assert!(rows(&learnt).learn_noise);
    let stated = [
        projected,
        "identifier.projected.position_noise=[1e-4]",
        "identifier.projected.input_resolution=[0.2]",
    ];
    let told = load("", &stated).unwrap();
    let noise = rows(&told).noise;
    assert!(!rows(&told).learn_noise);
    assert_eq!((noise.position_noise[1], noise.input_resolution[1]), (1e-4, 0.2));
    assert_eq!((noise.position_resolution[1], noise.input_noise[1]), (0.0, 0.0));
    for config in [&learnt, &told] {
        let again = load(&config.to_toml(), &[]).unwrap();
        assert_eq!(rows(&again), rows(config));
        assert_eq!(again.config_hash(), config.config_hash());
    }
    // a single floor is that of every equation
    let floor = load("", &[projected, "estimator.noise_floor=[0.5]"]).unwrap();
    let half = EquationNoise { std: 1.0, floor: 0.5 };
    assert_eq!(floor.estimator.options.equations, [half, half]);
    // settings besides own_plant.toml take effect
    let own = |sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
        Config::load(&[Config::embedded("own_plant").unwrap()], &sets).unwrap()
    };
    assert!(rows(&own(&[])).learn_noise);
    assert!(!rows(&own(&stated[1..])).learn_noise);
}

#[test]
fn regress_the_velocity_filter_has_a_time_and_recordings_of_before_keep_theirs() {
    let samples = |config: &Config| match config.identifier.rows {
        RowForm::Projected(rows) => rows.velocity_half_width,
        RowForm::Pointwise => 0,
    };
    for (period_s, expected) in [(0.5e-3, 16), (1e-3, 8), (2e-3, 4), (0.01, 3)] {
        let period = format!("plant.sample_period_s={period_s:?}");
        let window = "identifier.projected.window_s=0.1";
        let config = load("", &["identifier.rows=projected", &period, window]).unwrap();
        assert_eq!(samples(&config), expected, "{period_s}");
    }
    let text = load("", &["identifier.rows=projected", "plant.sample_period_s=0.002"])
        .unwrap()
        .to_toml()
        .replace("velocity_half_width_s = 0.008", "velocity_half_width = 12");
    assert!(text.contains("velocity_half_width = 12"));
    let recorded = Source::Recorded {
        name: "the recording's configuration".to_owned(),
        text,
    };
    let config = Config::load(&[recorded], &[]).unwrap();
    assert_eq!(samples(&config), 12);
    assert_eq!(config.file_form().projected.velocity_half_width_s, 0.024);
}

#[test]
fn regress_terms_of_the_arm_are_switched_on_by_configuration() {
    let rows = "identifier.rows=projected";
    let names = |sets: &[&str]| {
        let config = load("", sets).unwrap();
        let names: Vec<_> = config.model.parameters().iter().map(|p| p.name.to_string()).collect();
        (names, config.model.definition().hash(), config.config_hash())
    };
    let (plain, plain_model, plain_config) = names(&[rows]);
    let (friction, friction_model, friction_config) = names(&[rows, "model.coulomb_friction=true"]);
    assert_eq!(plain.len(), 9);
    assert_eq!(friction[5..7], ["coulomb_friction_1", "coulomb_inductance_1"]);
    assert_eq!(friction[11..], ["coulomb_friction_2", "coulomb_inductance_2"]);
    assert_ne!(plain_model, friction_model);
    assert_ne!(plain_config, friction_config);
    let delay = "identifier.projected.estimate_input_delay=true";
    let (all, ..) = names(&[rows, "model.coulomb_friction=true", "model.offset=true", delay]);
    assert_eq!(
        (all.len(), all[7].as_str(), all[15].as_str()),
        (16, "offset_1", "input_delay")
    );
    // an offset has a derivative, which is 0
    assert_eq!(names(&["model.offset=true"]).0.len(), 11);
    let servo = load("", &["model.kind=servo_axis", "model.offset=true"]).unwrap();
    let warning = &servo.warnings()[0];
    assert_eq!(warning.key, "model.offset");
    assert!(
        warning
            .message
            .contains("no effect unless model.kind is \"manipulator\""),
        "{warning}"
    );
}
