//! Handles that destroy themselves.

use super::context::Context;
use ash::vk;
use std::sync::Arc;

/// A handle that can be destroyed without knowing more than its device.
pub(super) trait Destroy: vk::Handle + Copy {
    /// Destroys the object.
    ///
    /// # Safety
    /// It belongs to `device`, is not in use, and is never used again.
    unsafe fn destroy(self, device: &ash::Device);
}

macro_rules! destroyed_by {
    ($($handle:ident: $method:ident;)*) => {$(
        impl Destroy for vk::$handle {
            unsafe fn destroy(self, device: &ash::Device) {
                // SAFETY: promised by the caller.
                unsafe { device.$method(self, None) }
            }
        }
    )*};
}

destroyed_by! {
    Buffer: destroy_buffer;
    BufferView: destroy_buffer_view;
    CommandPool: destroy_command_pool;
    DescriptorPool: destroy_descriptor_pool;
    DescriptorSetLayout: destroy_descriptor_set_layout;
    DeviceMemory: free_memory;
    Fence: destroy_fence;
    Framebuffer: destroy_framebuffer;
    Image: destroy_image;
    ImageView: destroy_image_view;
    Pipeline: destroy_pipeline;
    PipelineCache: destroy_pipeline_cache;
    PipelineLayout: destroy_pipeline_layout;
    QueryPool: destroy_query_pool;
    RenderPass: destroy_render_pass;
    ShaderModule: destroy_shader_module;
}

/// The one owner of a Vulkan object. The device must not use the object any more when it is dropped.
pub(super) struct Owned<T: Destroy> {
    /// The handle, for calls that borrow it.
    pub raw: T,
    context: Arc<Context>,
}

impl<T: Destroy> Owned<T> {
    /// Takes over a fresh object and names it.
    pub fn new(context: &Arc<Context>, name: &str, raw: T) -> Self {
        context.name(raw, name);
        Self { raw, context: Arc::clone(context) }
    }
}

impl<T: Destroy> Drop for Owned<T> {
    fn drop(&mut self) {
        // SAFETY: this is the only owner, and owners drop only what the device has finished with.
        unsafe { self.raw.destroy(&self.context.device) }
    }
}
