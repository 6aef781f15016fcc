#[path = "../tests/common/room.rs"] mod room;
use surflux::gather::cpu::*; use surflux::gather::*; use surflux::surfel::{cloud::*, drawable::*};
fn main(){ for m in [350usize,1000,14000] { let cloud=room::cloud(m,SurfelShape::Disc,1); let mut cloud=cloud; for f in cloud.flags.iter_mut(){*f=1}; let d=Drawables::new(&cloud,None);
 let mut g=CpuGatherer::new(&d,m,CpuSettings{resolution:8,batch:4096,frames_in_flight:1}).unwrap(); let mut r=room::receivers(4096*4,2); for x in r.iter_mut(){x.flags=0}
 for _ in 0..3 { let t=std::time::Instant::now(); let k= if m>5000 {1024} else {r.len()}; g.submit(Batch{receivers:r[..k].to_vec(),..Batch::default()}).unwrap(); g.finish().unwrap(); println!("{m}: {:.0}/s", k as f64/t.elapsed().as_secs_f64()); } } }
