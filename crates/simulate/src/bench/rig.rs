//! The rig file of a simulated bench.

use super::bar::Mount;
use super::bench_samples::SimulatedBench;
use super::quantity::BenchChannel;

/// Contents of a rig file of a simulated bench.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RigText {
    /// Model of the sensor.
    pub model: String,
    /// Its serial number.
    pub serial: String,
    /// Whether azimuth, sign and zero are omitted, for the analysis to find.
    pub to_be_fitted: bool,
}

impl SimulatedBench {
    /// A rig file with the truth of this bench; the field is left to be fitted. Its layout is that of
    /// `pipelines/bench.rig.toml`.
    #[must_use]
    pub fn rig_text(&self, what: &RigText) -> String {
        let (model, serial) = (&what.model, &what.serial);
        let head =
            format!("schema = 1\ntitle = \"Simulated bench\"\n\n[sensor]\nmodel = {model:?}\nserial = {serial:?}\n");
        let parts =
            [head, self.bar_text(what), self.encoder_text(what), self.site_text(), self.mounts(), self.clocks()];
        parts.join("\n")
    }

    fn bar_text(&self, what: &RigText) -> String {
        let bar = &self.settings.bar;
        let mount = match bar.mount {
            Mount::Upright => "upright",
            Mount::Hanging => "hanging",
            Mount::Custom(_) => "custom",
        };
        let mut text = format!("[bar]\nlength_m = {:?}\nmount = \"{mount}\"\n", bar.length_m);
        if !what.to_be_fitted {
            text += &format!("azimuth_deg = {:?}\n", tidy(bar.azimuth_rad.to_degrees()));
        }
        bar.flexible.iter().for_each(|mode| text += &format!("first_mode_hz = {:?}\n", mode.frequency_hz));
        text
    }

    fn encoder_text(&self, what: &RigText) -> String {
        let (name, encoder) = (self.encoder_name(), &self.settings.encoder);
        let mut text = format!(
            "[encoder]\nchannel = \"{name}\"\ncounts_per_rev = {}\ndecoding = {}\n",
            encoder.lines, encoder.decoding
        );
        if !what.to_be_fitted {
            text += &format!("sign = {}\nzero_deg = {:?}\n", encoder.sign, tidy(encoder.zero_rad.to_degrees()));
        }
        text
    }

    fn site_text(&self) -> String {
        let site = &self.settings.site;
        format!(
            "[site]\nlatitude_deg = {:?}\nlongitude_deg = {:?}\nheight_m = {:?}\ndate = \"{}\"\nfield = \"fit\"\n",
            site.latitude_deg,
            site.longitude_deg,
            site.height_m,
            day(self.settings.start.0)
        )
    }

    /// One for each place and mount shared by channels.
    fn mounts(&self) -> String {
        let mut mounts: Vec<(String, Vec<&str>)> = vec![];
        for (channel, sensor) in &self.settings.sensor {
            let arm = self.settings.lever_arm_m(*channel);
            let turned = sensor.rotation_rad.map(|r| tidy(r.to_degrees()));
            let mount = format!("lever_arm_m = {arm:?}\nrotation_deg = {turned:?}\n");
            match mounts.iter_mut().find(|(known, _)| *known == mount) {
                Some((_, channels)) => channels.push(channel.name()),
                None => mounts.push((mount, vec![channel.name()])),
            }
        }
        let one = |(mount, channels): &(String, Vec<&str>)| format!("[[mount]]\nchannels = {channels:?}\n{mount}");
        mounts.iter().map(one).collect::<Vec<_>>().join("\n")
    }

    fn clocks(&self) -> String {
        let clocks = &self.settings.clocks;
        if clocks.device.is_none() {
            return "[clock]\nshared = true\n".to_owned();
        }
        let anchor = BenchChannel::AngularRate;
        let known = self.channels.contains_key(&anchor);
        let anchor = if known { format!("anchor = {:?}\n", anchor.name()) } else { String::new() };
        format!("[clock]\nshared = false\n{anchor}")
    }
}

/// Removes the last bits left by a unit conversion.
fn tidy(value: f64) -> f64 {
    (value * 1e9).round() / 1e9
}

/// UTC day of a timestamp, `yyyy-mm-dd` (Howard Hinnant, "chrono-compatible low-level date algorithms").
pub(super) fn day(unix_ns: i64) -> String {
    let days = unix_ns.div_euclid(86_400 * flight::NANOS_PER_SECOND) + 719_468;
    let (era, of_era) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * of_year + 2) / 153;
    let day = of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}
