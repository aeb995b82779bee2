//! Rows of one element of a PLY file.

use std::fmt;
use std::marker::PhantomData;
use std::path::Path;

use serde::de::{Deserialize, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_ply::{ElementDef, PlyReader, PropertyType};

use crate::ModelError;

/// All rows of an element, flattened, in the order of its properties. It grows with the rows read: the header's count
/// is not trusted.
pub(super) struct Table<T> {
    pub(super) values: Vec<T>,
    rows: usize,
}

/// The names of an element's properties.
pub(super) fn names(element: &ElementDef) -> Vec<&str> {
    element.properties.iter().map(|p| p.name.as_str()).collect()
}

/// The rows of the element that comes next in a file.
pub(super) fn read<T: for<'de> Deserialize<'de>>(
    reader: &mut PlyReader<impl std::io::BufRead>,
    element: &ElementDef,
    path: &Path,
) -> Result<Table<T>, ModelError> {
    let is_list = |p: &PropertyType| matches!(p, PropertyType::List { .. });
    if let Some(list) = element
        .properties
        .iter()
        .find(|p| is_list(&p.property_type))
    {
        return Err(ModelError::format(
            path,
            format!("numbers as properties of `{}`", element.name),
            format!("the list `{}`", list.name),
        ));
    }
    let expected = || format!("{} rows of `{}`", element.count, element.name);
    let table: Table<T> = reader
        .next_element()
        .map_err(|e| ModelError::format(path, expected(), e.to_string()))?;
    if table.rows != element.count {
        let found = format!("{} before the end", table.rows);
        return Err(ModelError::format(path, expected(), found));
    }
    Ok(table)
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Table<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Rows<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Rows<T> {
            type Value = Table<T>;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("rows of numbers")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Table<T>, A::Error> {
                let (mut values, mut rows) = (Vec::new(), 0);
                while let Some(Row(row)) = seq.next_element()? {
                    values.extend(row);
                    rows += 1;
                }
                Ok(Table { values, rows })
            }
        }
        deserializer.deserialize_seq(Rows(PhantomData))
    }
}

/// One row's numbers in the order of its properties.
struct Row<T>(Vec<T>);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Row<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Numbers<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Numbers<T> {
            type Value = Row<T>;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("named numbers")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Row<T>, A::Error> {
                let mut values = Vec::new();
                while let Some((_, value)) = map.next_entry::<IgnoredAny, T>()? {
                    values.push(value);
                }
                Ok(Row(values))
            }
        }
        deserializer.deserialize_map(Numbers(PhantomData))
    }
}
