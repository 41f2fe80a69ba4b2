//! Many flights, many cores: plan, task, reduce, status
