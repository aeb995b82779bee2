mod layout;
mod values;
