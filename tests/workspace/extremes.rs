//! The cases of `dash stress` on every backend, and broken cases as negative controls.

use burn::tensor::{Device, Tensor};
use dash_kernels::testing::named_devices;
use dash_train::Error;
use dash_train::stress::{Case, Measured, Outcome, cases, long_cases, run};

/// The failing parts of a case, in words.
fn complaint(device: &str, outcome: &Outcome) -> String {
    let failing = outcome.parts.iter().filter(|part| !part.passes());
    let parts: Vec<String> = failing
        .map(|part| format!("{}: {:e} > {:e}", part.name, part.error, part.tolerance))
        .collect();
    format!(
        "{device}: {}/{}: finite: {}, {:?} {}",
        outcome.family,
        outcome.case,
        outcome.finite,
        outcome.failure,
        parts.join(", ")
    )
}

fn assert_family_passes(belongs: impl Fn(&Case) -> bool) {
    let chosen: Vec<Case> = cases().into_iter().filter(belongs).collect();
    assert!(!chosen.is_empty());
    let mut complaints = Vec::new();
    for (name, device) in named_devices() {
        for case in &chosen {
            let outcome = run(case, &device);
            if !outcome.passes {
                complaints.push(complaint(name, &outcome));
            }
        }
    }
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
}

#[test]
fn operations_withstand_extremes() {
    assert_family_passes(|case| !["scenes", "training"].contains(&case.family));
}

#[test]
fn scenes_withstand_extremes() {
    assert_family_passes(|case| case.family == "scenes");
}

#[test]
fn training_withstands_extremes() {
    assert_family_passes(|case| case.family == "training");
}

#[test]
fn cases_have_names_of_their_own() {
    let mut names: Vec<&str> = cases()
        .iter()
        .chain(&long_cases())
        .map(|c| c.name)
        .collect();
    let n = names.len();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), n);
}

/// Negative controls: lost values, wrong values, an error, a panic, nothing at all.
#[test]
fn what_is_broken_does_not_pass() {
    fn lost(device: &Device) -> Result<Measured, Error> {
        let values = Tensor::<1>::from_data([1.0, 0.0], device);
        let values = common_values(values.clone() / values);
        let mut measured = Measured::default();
        measured.agree("values", &values, &[1.0, 1.0], 1e-3);
        Ok(measured)
    }
    fn off(device: &Device) -> Result<Measured, Error> {
        let values = common_values(Tensor::<1>::from_data([1.0, 2.01], device));
        let mut measured = Measured::default();
        measured.agree("values", &values, &[1.0, 2.0], 1e-3);
        Ok(measured)
    }
    fn refused(_: &Device) -> Result<Measured, Error> {
        Err(Error::Config("refused".into()))
    }
    fn fault(_: &Device) -> Result<Measured, Error> {
        panic!("on purpose")
    }
    fn empty(_: &Device) -> Result<Measured, Error> {
        Ok(Measured::default())
    }
    fn common_values(tensor: Tensor<1>) -> Vec<f32> {
        tensor.into_data().try_into_vec().expect("f32")
    }
    for (name, device) in named_devices() {
        for (what, measure) in [
            ("lost", lost as fn(&Device) -> _),
            ("off", off),
            ("refused", refused),
            ("fault", fault),
            ("empty", empty),
        ] {
            let case = Case {
                family: "control",
                name: what,
                extreme: "broken on purpose",
                measure,
            };
            let outcome = run(&case, &device);
            assert!(!outcome.passes, "{name}: {what}");
            assert_eq!(
                outcome.finite,
                ["off", "empty"].contains(&what),
                "{name}: {what}"
            );
        }
    }
}
