//! A plant of the user's own as the programs see it: what it is, and how its identifier is made.

use super::Failure;
use crate::config::Config;
use crate::model::PlantDefinition;
use crate::node::identifier::Identifier;
use std::fmt;
use std::sync::Arc;

/// From a configuration to the identifier of one plant.
type Make = dyn Fn(&Config) -> Result<Box<dyn Identifier>, Failure> + Send + Sync;

/// A plant of the user's own as the programs see it.
#[derive(Clone)]
pub(super) struct OwnPlant {
    definition: PlantDefinition,
    make: Arc<Make>,
}

impl OwnPlant {
    pub(super) fn new(
        definition: PlantDefinition,
        make: impl Fn(&Config) -> Result<Box<dyn Identifier>, Failure> + Send + Sync + 'static,
    ) -> Self {
        Self {
            definition,
            make: Arc::new(make),
        }
    }

    pub(super) fn definition(&self) -> &PlantDefinition {
        &self.definition
    }

    pub(super) fn identifier(&self, config: &Config) -> Result<Box<dyn Identifier>, Failure> {
        (self.make)(config)
    }
}

impl fmt::Debug for OwnPlant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("OwnPlant").field(&self.definition.name).finish()
    }
}
