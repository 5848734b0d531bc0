//! `--set section.key=value` for the sections that only a robot's file has.

use toml::{Table, Value};

/// Sections of a robot's file that no other configuration has, or that have another meaning there.
const OWN: [&str; 7] = ["model", "drive", "friction", "log", "identify", "simulate", "excite"];

/// True if an argument sets a key of a robot's own sections; `model.kind` chooses the robot itself.
pub fn is_robot_override(argument: &str) -> bool {
    let key = argument.split('=').next().unwrap_or_default().trim();
    let section = key.split('.').next().unwrap_or_default();
    OWN.contains(&section) && key.contains('.') && key != "model.kind"
}

/// Applies such an argument to a robot's file.
///
/// # Errors
/// What was expected, if the argument is not a key and a value.
pub(super) fn lay(table: &mut Table, argument: &str) -> Result<(), String> {
    let (key, text) = argument
        .split_once('=')
        .ok_or_else(|| "expected section.key=value, for example identify.block_s=0.5, got no \"=\"".to_owned())?;
    let (section, name) = key.trim().split_once('.').unwrap_or_default();
    let value = value(text.trim())?;
    match table.entry(section).or_insert_with(|| Value::Table(Table::new())) {
        Value::Table(inside) => _ = inside.insert(name.to_owned(), value),
        _ => return Err(format!("expected a section [{section}] in the file, got another value")),
    }
    Ok(())
}

/// A bare word is a string, so that no quotes need escaping in a shell.
fn value(text: &str) -> Result<Value, String> {
    match format!("value = {text}").parse::<Table>() {
        Ok(mut table) if table.len() == 1 => Ok(table.remove("value").unwrap_or_else(|| text.into())),
        Err(error) if text.starts_with(['[', '{', '"', '\'']) => {
            Err(format!("not a TOML value: {}", error.message().trim_end()))
        }
        _ => Ok(text.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_only_keys_of_a_robots_own_sections_are_laid_over_its_file() {
        let own = [
            "identify.block_s=0.5",
            "simulate.payload=[]",
            "log.time_column=2",
            "model.tip=x",
        ];
        assert!(own.iter().all(|argument| is_robot_override(argument)));
        let other = [
            "plant.seed=1",
            "model.kind=arm",
            "identifier.rows=x",
            "identify",
            "plant.a=log.b",
        ];
        assert!(other.iter().all(|argument| !is_robot_override(argument)));
    }

    #[test]
    fn regress_values_are_toml_or_bare_words() {
        let mut table: Table = "[identify]\nblock_s = 1.0\n".parse().expect("TOML");
        for argument in [
            "identify.block_s = 0.5",
            "simulate.motion=rest",
            "drive.gain=[1, 2.5]",
            "simulate.payload=[{ t_s = 1 }]",
        ] {
            lay(&mut table, argument).expect(argument);
        }
        assert_eq!(table["identify"]["block_s"].as_float(), Some(0.5));
        assert_eq!(table["simulate"]["motion"].as_str(), Some("rest"));
        assert_eq!(table["drive"]["gain"][1].as_float(), Some(2.5));
        assert_eq!(table["simulate"]["payload"][0]["t_s"].as_integer(), Some(1));
        let error = lay(&mut table, "drive.gain=[1,").expect_err("a list without an end");
        assert!(error.contains("not a TOML value"), "{error}");
        assert!(
            lay(&mut table, "drive.gain")
                .expect_err("no value")
                .contains("no \"=\"")
        );
    }
}
