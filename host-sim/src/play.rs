//! Sound card.
