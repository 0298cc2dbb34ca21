"""Pictures and maps whose gradient follows moving silhouette edges."""
