//! Pages and figures against the records they are made from.

mod fixture;
mod hostile;
mod html;
mod pages;
