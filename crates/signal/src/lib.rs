//! Arithmetic on series: integrals, held samples, decimation, robust statistics
