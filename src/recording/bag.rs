//! The messages of one type in any MCAP file: plain, or in chunks compressed with lz4 or zstd.

use super::bag_error::BagError;
use super::record_file::decompress;
use mcap::McapError;
use mcap::read::LinearReader;
use mcap::records::{MessageHeader, Record};
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// Passes the messages whose schema has this name to `take`: topic, header, data. `bytes` are those
/// of `file`, for messages.
///
/// # Errors
/// What was expected and found in the file; or the first error of `take`.
pub(super) fn messages_of(
    file: &Path,
    bytes: &[u8],
    schema: &str,
    take: &mut dyn FnMut(&str, &MessageHeader, &[u8]) -> Result<(), BagError>,
) -> Result<(), BagError> {
    let mut bag = Bag {
        schema,
        schemas: HashSet::new(),
        topics: HashMap::new(),
    };
    let in_words = |error: McapError| BagError::Mcap {
        file: file.to_owned(),
        source: Box::new(error),
    };
    let mut plain = Vec::new();
    for record in LinearReader::new(bytes).map_err(in_words)? {
        let record = record.map_err(in_words)?;
        let Record::Chunk { header, data } = &record else {
            bag.record(&record, take)?;
            continue;
        };
        if !decompress(header, data, &mut plain) {
            return Err(BagError::Chunk {
                file: file.to_owned(),
                compression: header.compression.clone(),
            });
        }
        for record in LinearReader::sans_magic(&plain) {
            bag.record(&record.map_err(in_words)?, take)?;
        }
    }
    Ok(())
}

/// Definitions in the file so far.
struct Bag<'a> {
    schema: &'a str,
    /// Schemas of that name.
    schemas: HashSet<u16>,
    /// Topics of such a schema, by channel.
    topics: HashMap<u16, String>,
}

impl Bag<'_> {
    fn record(
        &mut self,
        record: &Record<'_>,
        take: &mut dyn FnMut(&str, &MessageHeader, &[u8]) -> Result<(), BagError>,
    ) -> Result<(), BagError> {
        match record {
            Record::Schema { header, .. } if header.name == self.schema => {
                self.schemas.insert(header.id);
            }
            Record::Channel(channel) if self.schemas.contains(&channel.schema_id) => {
                self.topics.insert(channel.id, channel.topic.clone());
            }
            Record::Message { header, data } => {
                if let Some(topic) = self.topics.get(&header.channel_id) {
                    take(topic, header, data)?;
                }
            }
            _ => {}
        }
        Ok(())
    }
}
